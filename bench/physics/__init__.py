"""Controllers on robots with mass, servos, delays and noise: what holds there, and what does not."""
