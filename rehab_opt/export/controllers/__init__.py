"""One file a controller: what of it goes into C, and what is recorded."""
