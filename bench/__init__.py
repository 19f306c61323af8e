"""Measuring commands of the project; README.md in this folder says what each one prints."""
