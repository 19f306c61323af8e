"""Closed-loop runs of a problem file: what is read, how it is run, what is reported."""
