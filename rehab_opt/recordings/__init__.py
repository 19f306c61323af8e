"""Recordings of a hand or of joints, read from the formats that laboratories have; no problem file is needed."""
