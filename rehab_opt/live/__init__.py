"""A local web page on which a problem runs in real time."""
