"""Many people at once: one problem for each of them, on every core or on a cluster."""
