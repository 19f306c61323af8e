"""Recorder of the QPs that a running controller solves, for inspection; without cost where it is off.

A solver made within `recording_qps` records every problem before it solves it; one made elsewhere is the same machine
code as without a recorder.
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
    """The QPs of one solver, in the order in which it met them; the numbers that make them, until they are asked for.

    Parameters
    ----------
    name : of the statement.
    tolerance : certificate tolerance of who solves it.
    make : the instance from what `see` is given.
    ticks : whether they are a controller's, one a tick; iterations, and fits that are made once, are not.
    skip, most : how many are let pass first, and how many are then kept.
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
        """One QP, by the numbers that make it; they are copied."""
        self.met += 1
        if self.met > self._skip and (self._most is None or len(self._seen) < self._most):
            self._seen.append(tuple(np.array(value) for value in values))

    def __len__(self) -> int:
        return len(self._seen)

    @property
    def seen(self) -> list[tuple[Array, ...]]:
        """The numbers that `see` was given, of those that were kept."""
        return list(self._seen)

    def instances(self) -> list[Instance]:
        """Those that were kept."""
        return [self._make(*values) for values in self._seen]


class QPRecorder:
    """Streams of QPs, one for each solver that was made meanwhile; see `recording_qps`."""

    def __init__(self, *, skip: int = 0, most: int | None = None) -> None:
        self.streams: list[Stream] = []
        self.open = True
        self._skip, self._most = skip, most
        self._shared: dict[str, Stream] = {}

    def stream(
        self, name: str, tolerance: float, make: Callable[..., Instance], *, ticks: bool = True, shared: bool = False
    ) -> Stream:
        """A new stream, or, where it is shared, the one of that name."""
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
        """`solve`, before which the stream sees the values of now; but not what is only tried again."""

        def seen_and_solved() -> None:
            if self.open and not unless():
                stream.see(*values())
            solve()

        return seen_and_solved


_NOW: ContextVar[QPRecorder | None] = ContextVar("recorder", default=None)


def recorder_now() -> QPRecorder | None:
    """Who wants to know of the solvers that are made now, or None."""
    return _NOW.get()


@contextmanager
def recording_qps(*, skip: int = 0, most: int | None = None) -> Iterator[QPRecorder]:
    """Within it, solvers that are made report their QPs; what is made before or after does not.

    Parameters
    ----------
    skip, most : of each solver's QPs, how many are let pass first, and how many are then kept; None for all.
    """
    recorder = QPRecorder(skip=skip, most=most)
    token = _NOW.set(recorder)
    try:
        yield recorder
    finally:
        _NOW.reset(token)
        recorder.open = False
