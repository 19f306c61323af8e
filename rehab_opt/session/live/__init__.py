"""Live runs of the kinds of problems."""
