"""The papers' own controllers, kept as the yardstick beside ours."""
