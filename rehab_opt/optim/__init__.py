"""State, solve and certify optimisation problems; independent of robots."""
