"""Batch runs of one problem for many people, on all cores of a machine or on a cluster."""
