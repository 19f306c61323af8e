"""What the tests of the loop share."""

import pytest

from rehab_opt.loop import loop as looping
from rehab_opt.loop import scheduling
from tests.loop.clock import Clock


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The loop's clock."""
    made = Clock()
    for module in (looping, scheduling):
        monkeypatch.setattr(module, "time", made)
    monkeypatch.setattr(looping, "monotonic", made.monotonic)
    return made
