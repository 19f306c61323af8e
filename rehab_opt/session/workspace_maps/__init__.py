"""System `workspace_map`: maps between two workspaces, by our safe rule and by the published rule."""
