"""Controllers: state in, `Command` out; one controller per file."""
