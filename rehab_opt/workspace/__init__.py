"""Reachable workspaces of a limb, and maps between them."""
