"""Read recordings of a hand or of joints in common laboratory formats."""
