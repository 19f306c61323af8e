"""The five scenarios of Rossa et al. in closed loop: a simulated person, a robot with a force loop, and assistance."""
