"""Demonstrations, and the force fields learnt from them."""
