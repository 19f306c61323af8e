"""Demonstrations, and force fields learnt from them."""
