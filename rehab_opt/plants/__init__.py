"""Plants, that is simulated robots: ideal joints, and MuJoCo arms with servos, delays, noise and contact."""
