"""Controllers as C: a source file and a header each, with a recorded run that the C code repeats."""
