"""Controllers as C: one source file and one header each, with a recorded run that they repeat."""
