"""Measuring commands of the project; README.md in this folder says what each one prints."""

import os

os.environ.setdefault("REHAB_OPT_COMPILE", "wait")  # what is measured is machine code from the first tick on
