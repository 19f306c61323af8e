"""What threads share: one CasADi function for all, arrays to evaluate it on for each; or the text of a function."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

import casadi as ca
from numpy.typing import NDArray

from rehab_opt.symbolic.buffered import BufferedFunction

__all__ = ["REMEMBERED", "Evaluator", "PerThread", "read_back"]

T = TypeVar("T")

REMEMBERED = 32
"""Forms that are remembered; the text of one takes up to 3 MB."""

_texts: dict[Hashable, str | None] = {}
"""By form, that of the last use last; None where it was made once."""


class PerThread(threading.local, Generic[T]):
    """One object for each thread, made when the thread first asks for `mine`.

    An object that looks immutable must keep no array that a call overwrites but in here: CasADi lets other threads run
    while it evaluates, so that a shared buffer gives another thread's numbers, or ends the process. The function itself
    may be shared. What dies with a thread is that thread's object.

    Parameters
    ----------
    make : makes one; called in the thread that asks, so it should not compile.
    """

    def __init__(self, make: Callable[[], T]) -> None:  # Python calls it again in each thread
        self.mine = make()


class Evaluator:
    """Values of expressions: a function is built for each when it is first asked for; any thread may ask."""

    def __init__(self) -> None:
        self._functions: dict[str, PerThread[BufferedFunction]] = {}

    def of(self, expression: Callable[..., ca.SX], *values: NDArray[Any]) -> NDArray[Any]:
        """Value of a named function from expressions to one expression, at arrays of always the same shapes."""
        known = self._functions.get(expression.__name__)
        if known is None:
            symbols = [ca.SX.sym("value", *value.shape) for value in values]
            function = ca.Function("of", symbols, [ca.densify(expression(*symbols))], {"cse": True})
            made = PerThread(lambda: BufferedFunction(function))
            known = self._functions.setdefault(expression.__name__, made)  # should two threads have built it at once
        return known.mine.of(*values)


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
