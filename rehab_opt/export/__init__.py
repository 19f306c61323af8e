"""Export controllers as C: for each a source file, a header, and a recorded run that the C code repeats."""
