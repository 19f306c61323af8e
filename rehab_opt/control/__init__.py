"""State in, Command out; one controller a file."""
