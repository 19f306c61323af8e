"""Recorder of the QPs that a running controller solves, for inspection; no cost when off.

A solver made within `recording_qps` records every problem before it solves it; other solvers are unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from numpy.typing import NDArray

from rehab_opt.optim.rows import Instance

__all__ = ["QPRecorder", "Stream", "recorder_now", "recording_qps"]

Array = NDArray[np.float64]


class Stream:
    """QPs of one solver, in order; stored as parameters until `instances` makes the QPs.

    Parameters
    ----------
    name : of the statement. tolerance : certificate tolerance of the solver.
    make : function from the arguments of `see` to an instance.
    ticks : whether there is one QP a tick, as in a controller; False for iterations and fits.
    skip, most : number of QPs that are skipped first, and largest number that is then recorded.
    """

    def __init__(
        self,
        name: str,
        tolerance: float,
        make: Callable[..., Instance],
        *,
        ticks: bool = True,
        skip: int,
        most: int | None,
    ) -> None:
        self.name, self.tolerance, self.ticks, self.met = name, tolerance, ticks, 0
        self._make, self._skip, self._most = make, skip, most
        self._seen: list[tuple[Array, ...]] = []

    def see(self, *values: Array) -> None:
        """Record one QP by its parameters, which are copied."""
        self.met += 1
        if self.met > self._skip and (self._most is None or len(self._seen) < self._most):
            self._seen.append(tuple(np.array(value) for value in values))

    def __len__(self) -> int:
        return len(self._seen)

    @property
    def seen(self) -> list[tuple[Array, ...]]:
        """Recorded arguments of `see`."""
        return list(self._seen)

    def instances(self) -> list[Instance]:
        """Recorded QPs."""
        return [self._make(*values) for values in self._seen]


class QPRecorder:
    """Streams of QPs, one for each solver made while it is active; see `recording_qps`."""

    def __init__(self, *, skip: int = 0, most: int | None = None) -> None:
        self.streams: list[Stream] = []
        self.open = True
        self._skip, self._most = skip, most
        self._shared: dict[str, Stream] = {}

    def stream(
        self, name: str, tolerance: float, make: Callable[..., Instance], *, ticks: bool = True, shared: bool = False
    ) -> Stream:
        """A new stream, or, with `shared`, the existing one of that name."""
        if shared and name in self._shared:
            return self._shared[name]
        found = Stream(name, tolerance, make, ticks=ticks, skip=self._skip, most=self._most)
        self.streams.append(found)
        if shared:
            self._shared[name] = found
        return found

    def watched(
        self,
        solve: Callable[[], None],
        stream: Stream,
        values: Callable[[], tuple[Array, ...]],
        *,
        unless: Callable[[], bool] = lambda: False,
    ) -> Callable[[], None]:
        """Function that calls `solve` and first records `values()`, unless `unless()` is true."""

        def seen_and_solved() -> None:
            if self.open and not unless():
                stream.see(*values())
            solve()

        return seen_and_solved


_NOW: ContextVar[QPRecorder | None] = ContextVar("recorder", default=None)


def recorder_now() -> QPRecorder | None:
    """Active recorder, or None."""
    return _NOW.get()


@contextmanager
def recording_qps(*, skip: int = 0, most: int | None = None) -> Iterator[QPRecorder]:
    """Context in which new solvers record their QPs; solvers made outside do not.

    `skip` and `most` are the numbers of QPs of each solver to skip, then to record; None for all.
    """
    recorder = QPRecorder(skip=skip, most=most)
    token = _NOW.set(recorder)
    try:
        yield recorder
    finally:
        _NOW.reset(token)
        recorder.open = False
