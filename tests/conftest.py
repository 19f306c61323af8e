"""What every test may use."""

import os

from hypothesis import settings

# The recordings' fixture lives beside the tests that read most of them.
from tests.session.conftest import recorded

__all__ = ["recorded"]

# A test sees what it asked for, from its first tick on.
os.environ.setdefault("REHAB_OPT_COMPILE", "wait")

# A first call builds CasADi functions and says nothing about the time of the next: no deadline on one example.
settings.register_profile("rehab_opt", deadline=None, print_blob=True)
settings.load_profile("rehab_opt")
