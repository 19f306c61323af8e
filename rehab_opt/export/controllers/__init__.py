"""One file per controller: its functions in C, and its recorded run."""
