"""What every test may use."""

from hypothesis import settings

# The recordings' fixture lives beside the tests that read most of them.
from tests.session.conftest import recorded

__all__ = ["recorded"]

# A first call builds CasADi functions and says nothing about the time of the next: no deadline on one example.
settings.register_profile("rehab_opt", deadline=None, print_blob=True)
settings.load_profile("rehab_opt")
