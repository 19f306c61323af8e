"""Reachable workspaces of an arm, and maps between them."""
