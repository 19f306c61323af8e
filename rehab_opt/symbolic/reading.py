"""Functions that are made again and again: from the third time on they are read back from text, which is quicker."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import casadi as ca

__all__ = ["REMEMBERED", "read_back"]

REMEMBERED = 32
"""Forms that are remembered; the text of one takes up to 3 MB."""

_texts: dict[Hashable, str | None] = {}
"""By form, that of the last use last; None where it was made once."""


def read_back(form: Hashable, make: Callable[[], ca.Function]) -> ca.Function:
    """What `make` gives, or a copy of what it gave for an equal form, which must say all that it depends on.

    A copy computes the same to the last bit, and generates the same C. It is not the first function itself, since
    CasADi counts references without a lock, and threads may use their functions at once. Text is written the second
    time: it takes a while, which is lost where nothing is made again.
    """
    text = _texts.pop(form, "")
    function = ca.Function.deserialize(text) if text else make()
    for oldest in list(_texts)[: 1 - REMEMBERED]:
        _texts.pop(oldest, None)
    _texts[form] = text or (function.serialize() if text is None else None)
    return function
