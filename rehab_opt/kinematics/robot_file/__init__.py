"""Robot files: URDF and MJCF as links of a serial chain."""
