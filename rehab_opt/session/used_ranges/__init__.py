"""The ranges of motion used in recorded reaches, and where an arm of such a range reaches."""
