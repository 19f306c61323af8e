"""How kinds of problems are live."""
