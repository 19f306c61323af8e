"""QPs that controllers solve in a run, recorded tick after tick, written to a file and read again."""
