"""The papers' own laws, kept as the yardstick beside ours."""
