"""Maps between two workspaces, by our safe rule and by the published one."""
