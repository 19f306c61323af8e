"""No spoilt recording ends in a traceback, a hang or a wrong number (100 000 of them: `malformed.py`)."""

from __future__ import annotations

from tests.session.malformed import malformed


def test_spoilt_recordings_are_refused_or_read_as_they_are() -> None:
    made_of, wrong = malformed(400, seed=20261123)
    assert dict(wrong) == {}
    assert len(made_of) > 50
