"""A robot whose tool follows a moving pose."""
