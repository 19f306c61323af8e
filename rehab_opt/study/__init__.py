"""Studies: a folder with people, their sessions and trials; comparisons between groups, and reports."""
