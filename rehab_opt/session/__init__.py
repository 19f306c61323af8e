"""Closed-loop runs of a problem file: reading it, running it and reporting the result."""
