"""Robots to try controllers on: joints that move as commanded, and MuJoCo's with servos, delays, noise and contact."""
