"""What tests of controllers keep is let go of at the end: Ruckig reports what outlives the interpreter."""

from collections.abc import Iterator

import pytest

from tests.control.every_controller import kept


@pytest.fixture(scope="session", autouse=True)
def _let_go() -> Iterator[None]:
    yield
    kept.cache_clear()
