"""One workspace mapped onto another, by the safe rule and by the published one."""
