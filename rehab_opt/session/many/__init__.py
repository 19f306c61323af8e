"""Batch runs: one problem for each person, on every core or on a cluster."""
