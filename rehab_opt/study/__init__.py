"""A study: people, their sessions and trials in one file, compared and reported. No network."""
