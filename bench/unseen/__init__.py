"""The mirror on recordings that nobody tuned it to."""
