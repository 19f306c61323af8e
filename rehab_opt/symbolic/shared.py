"""Sharing between threads: common CasADi functions with buffers per thread, and a cache of functions."""

from __future__ import annotations

import hashlib
import io
import pickle
import threading
from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any, Generic, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic.buffered import BufferedFunction

__all__ = ["ATOMIC", "REMEMBERED", "Evaluator", "HasEvaluator", "PerThread", "form_of_parts", "remembered"]

T = TypeVar("T")

REMEMBERED = 64
"""Size of the cache of functions; an entry takes 1 to 5 MB."""
ATOMIC = "-DCASADI_WITH_THREADSAFE_SYMBOLICS" in ca.CasadiMeta.compiler_flags()

_made: dict[Hashable, Any] = {}
"""Cached objects by form, the last used one last."""


class PerThread(threading.local, Generic[T]):
    """One object per thread, made by `make` when the thread first reads `mine`.

    CasADi lets other threads run while it evaluates, so a shared buffer could return another thread's numbers or crash
    the process. Immutable objects must therefore keep buffers only in here; the function itself may be shared.
    """

    def __init__(self, make: Callable[[], T]) -> None:  # Python calls it again in each thread
        self.mine = make()


class Evaluator:
    """Evaluate expressions; a function is built for each at first use. Any thread may use it."""

    def __init__(self) -> None:
        self._functions: dict[str, PerThread[BufferedFunction]] = {}

    def of(self, expression: Callable[..., ca.SX], *values: NDArray[Any]) -> NDArray[Any]:
        """Numerical value of a symbolic function at arrays, which must have the same shapes in every call."""
        known = self._functions.get(expression.__name__)
        if known is None:
            symbols = [ca.SX.sym("value", *value.shape) for value in values]
            function = ca.Function("of", symbols, [ca.densify(expression(*symbols))], {"cse": True})
            made = PerThread(lambda: BufferedFunction(function))
            known = self._functions.setdefault(expression.__name__, made)  # two threads may have built it at once
        return known.mine.of(*values)


class HasEvaluator:
    """Base of immutable objects that evaluate expressions; their functions are not pickled."""

    @cached_property
    def _evaluator(self) -> Evaluator:
        return Evaluator()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_evaluator"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False  # pickle forgets it
        self.__dict__.update(state)


def remembered(form: Hashable, make: Callable[[], T]) -> T:
    """Result of `make()`, cached under the key `form`, which must contain everything that the result depends on.

    Threads may share the result, since CasADi's wheels count references atomically. With other builds of CasADi, and
    with the form None, nothing is cached.
    """
    if form is None or not ATOMIC:
        return make()
    made = _made.pop(form, None) or make()
    for oldest in list(_made)[: 1 - REMEMBERED]:
        _made.pop(oldest, None)
    _made[form] = made
    return made


def form_of_parts(*parts: object) -> bytes | None:
    """Digest of all parts, a key for `remembered`; None if a part is a user's code, which may change unnoticed."""
    written = io.BytesIO()
    try:
        _Parts(written).dump(parts)
    except (pickle.PicklingError, TypeError, AttributeError):
        return None
    return hashlib.sha256(written.getvalue()).digest()


class _Parts(pickle.Pickler):
    def reducer_override(self, part: Any) -> Any:
        home = getattr(part, "__module__", None) or type(part).__module__
        known = home.partition(".")[0] in {"rehab_opt", "numpy", "casadi", "builtins", "copyreg"}
        if isinstance(part, ca.SX | ca.MX) or not known:
            raise pickle.PicklingError(home)
        if isinstance(part, type) or not home.startswith("rehab_opt"):
            return NotImplemented
        reduced = part.__reduce_ex__(4)
        if len(reduced) < 3 or not isinstance(reduced[2], dict):
            return reduced
        own = {k: v for k, v in reduced[2].items() if not isinstance(getattr(type(part), k, None), cached_property)}
        return *reduced[:2], own, *reduced[3:]
