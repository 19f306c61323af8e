"""A robot that leads a hand along the other hand's mirrored path."""
