"""What every test may use."""

import os

import pytest
from hypothesis import settings

# The recordings' fixture lives beside the tests that read most of them.
from tests.session.conftest import recorded

__all__ = ["recorded", "shipped"]

# A test sees what it asked for, from its first tick on.
os.environ.setdefault("REHAB_OPT_COMPILE", "wait")
# Compiled in a sixth of the time, with the same numbers; `shipped` is for claims about the code that users get.
os.environ.setdefault("REHAB_OPT_OPTIMISE", "0")

# A first call builds CasADi functions and says nothing about the time of the next: no deadline on one example.
settings.register_profile("rehab_opt", deadline=None, print_blob=True)
settings.load_profile("rehab_opt")


@pytest.fixture
def shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Functions are compiled as a user's are."""
    monkeypatch.delenv("REHAB_OPT_OPTIMISE", raising=False)
