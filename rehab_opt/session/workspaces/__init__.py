"""System `workspace`: reachable workspaces of a person's arm in a horizontal plane."""
