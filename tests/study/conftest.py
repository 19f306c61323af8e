"""Files of a test's own folder."""

from tests.session.conftest import written

__all__ = ["written"]
