"""Files of a test's own folder."""

from tests.session.conftest import recorded, written

__all__ = ["recorded", "written"]
