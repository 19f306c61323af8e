"""Robots from the files that describe them: URDF and MJCF as links of a serial chain."""
