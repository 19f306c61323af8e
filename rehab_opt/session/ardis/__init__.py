"""One stick moves a wheelchair and the arm on it."""
