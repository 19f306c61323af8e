"""The papers' own controllers, for comparison."""
