"""When a simulated person means to be where on a path: by the clock, or as far ahead of where they see themselves."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np

from rehab_opt.session.scenario.intention import Intention

__all__ = ["AIMS", "Aims", "Pace"]

Aims = Literal["clock", "path"]
AIMS: tuple[Aims, ...] = get_args(Aims)
"""Towards where the hand should be by now, however far it is behind; or along the path at the same pace, but never more
than a way ahead of where the person sees the hand on it."""
LONGER = 2
"""Times the ticks of the intention: a person who waits for the hand has so long."""
SIGHT = 0.01
"""[m] of the path ahead among which a person sees where the hand is; it never goes back."""
STEP = 5e-4
"""[m] between the places that are told apart."""


class Pace:
    """Which tick of an intention is meant in each tick of a trial.

    Parameters
    ----------
    intention : tick by tick. aims : by what. ahead : [m] of the path, at most, for "path".
    """

    def __init__(self, intention: Intention, aims: Aims, *, ahead: float) -> None:
        self._last = len(intention.places) - 1
        self._waits, self._ahead = aims == "path", ahead
        self.ticks = (LONGER if self._waits else 1) * len(intention.places)
        """[ticks] A trial is no longer than this."""
        steps = np.linalg.norm(np.diff(intention.places, axis=0), axis=1)
        travelled = np.concatenate(([0.0], np.cumsum(steps)))
        self._arc: list[float] = travelled.tolist()
        self._rest = int(np.searchsorted(travelled, travelled[-1] * (1 - 1e-9)))
        count = max(2, math.ceil(travelled[-1] / STEP) + 1)
        along = np.linspace(0.0, travelled[-1], count)
        self._step = float(along[1]) or 1.0
        columns = [np.interp(along, travelled, intention.places[:, axis]) for axis in (0, 1)]
        self._places: list[list[float]] = np.column_stack(columns).tolist()
        self._sight = math.ceil(SIGHT / self._step)
        self._seen = self._tick = 0

    @property
    def over(self) -> bool:
        """Whether the last tick of the intention was meant."""
        return self._tick >= self._last

    def meant(self, x: float, y: float) -> tuple[int, bool]:
        """The tick of the intention that is meant now, and whether the person goes on from there, of a hand there."""
        if not self._waits:
            self._tick += 1
            return min(self._tick - 1, self._last), True
        places, seen = self._places, self._seen
        nearest = math.inf
        for i in range(seen, min(seen + self._sight + 1, len(places))):
            away = math.hypot(places[i][0] - x, places[i][1] - y)
            if away < nearest:
                nearest, self._seen = away, i
        tick = self._tick
        goes_on = tick >= self._rest or self._arc[tick] <= self._seen * self._step + self._ahead
        if goes_on and tick < self._last:
            self._tick += 1
        return tick, goes_on
