"""A person's intended motion in a trial: positions by time, or by progress along a path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["AIMS", "Aims", "Intention", "Pace", "held", "nearest_next", "reached", "traced"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Intention:
    """The motion of the hand that a person intends, in N ticks.

    Attributes
    ----------
    places, velocities : intended positions and velocities (N, 2) [m], [m/s].
    goal : index (N,) in `goals` of the current goal.
    goals : points (M, 2) [m] to reach or to hold.
    active : whether each tick (N,) counts in the scores; ticks of motion between two held goals do not count.
    """

    places: Array
    velocities: Array
    goal: NDArray[np.int64]
    goals: Array
    active: NDArray[np.bool_]


def minimum_jerk(fraction: ArrayLike) -> Array:
    """Fraction of its distance that a minimum-jerk motion has covered after the fraction u of its duration.

    The result is 10 u^3 - 15 u^4 + 6 u^5. Source: Flash and Hogan 1985.
    """
    u = np.clip(np.asarray(fraction, dtype=np.float64), 0.0, 1.0)
    return np.asarray(u**3 * (10.0 + u * (-15.0 + 6.0 * u)))


def reached(path: Array, *, seconds: float, rest: float, dt: float) -> Intention:
    """A minimum-jerk motion along a path (M, 2) [m] in `seconds`, then rest at the path's end for `rest` [s]."""
    time = dt * np.arange(math.ceil((seconds + rest) / dt))
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    along = travelled[-1] * minimum_jerk(time / seconds)
    places = np.column_stack([np.interp(along, travelled, path[:, axis]) for axis in (0, 1)])
    everywhere = np.ones(len(time), dtype=bool)
    return Intention(places, _velocities(places, dt), np.zeros(len(time), dtype=np.int64), path[-1:], everywhere)


def traced(path: Array, *, seconds: float, rest: float, dt: float) -> Intention:
    """A motion through equally timed samples (M, 2) [m] in `seconds`, then rest at the last sample for `rest` [s]."""
    time = dt * np.arange(math.ceil((seconds + rest) / dt))
    at = np.linspace(0.0, seconds, len(path))
    places = np.column_stack([np.interp(time, at, path[:, axis]) for axis in (0, 1)])
    everywhere = np.ones(len(time), dtype=bool)
    return Intention(places, _velocities(places, dt), np.zeros(len(time), dtype=np.int64), path[-1:], everywhere)


def held(points: Array, *, move: float, dwell: float, dt: float) -> Intention:
    """Minimum-jerk motions of `move` [s] between the points (M, 2) [m]; the hand rests `dwell` [s] at each point.

    The motion begins at the first point. Only ticks of rest are `active`.
    """
    moving, holding = math.ceil(move / dt), math.ceil(dwell / dt)
    way = minimum_jerk(np.arange(1, moving + 1) / moving)[:, None]
    places, goal, active = [], [], []
    before = points[0]
    for i, point in enumerate(points):
        if i:
            places.append(before + way * (point - before))
            goal += [i] * moving
            active += [False] * moving
        places.append(np.tile(point, (holding, 1)))
        goal += [i] * holding
        active += [True] * holding
        before = point
    there = np.concatenate(places)
    return Intention(there, _velocities(there, dt), np.array(goal), points, np.array(active))


def nearest_next(points: Array) -> Array:
    """Points (M, 2) sorted so that the nearest remaining point follows each point; the first point stays first."""
    left = list(range(1, len(points)))
    order = [0]
    while left:
        away = np.linalg.norm(points[left] - points[order[-1]], axis=1)
        order.append(left.pop(int(np.argmin(away))))
    return points[order]


def _velocities(places: Array, dt: float) -> Array:
    return np.gradient(places, dt, axis=0) if len(places) > 1 else np.zeros_like(places)


Aims = Literal["clock", "path"]
AIMS: tuple[Aims, ...] = get_args(Aims)
"""With "clock", the person intends the position for the current time, however far the hand lags behind. With "path",
the intended position moves at the same speed but waits when it is too far ahead of the hand on the path."""
LONGER = 2
"""Largest duration of a trial with "path", as a multiple of the intention's duration."""
SIGHT = 0.01
"""Length [m] of path, from the hand's last progress on, in which the path point nearest to the hand is searched."""
STEP = 5e-4
"""Spacing [m] of the path points in this search."""


class Pace:
    """A person's progress through an intention during a trial.

    Parameters
    ----------
    intention : the intended motion. aims : "clock" or "path", as explained at `AIMS`.
    ahead : with "path", largest distance [m] by which the intended position leads the hand along the path.
    """

    def __init__(self, intention: Intention, aims: Aims, *, ahead: float) -> None:
        self._last = len(intention.places) - 1
        self._waits, self._ahead = aims == "path", ahead
        self.ticks = (LONGER if self._waits else 1) * len(intention.places)
        """Largest number of ticks of a trial."""
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
        """Whether the intention has reached its last tick."""
        return self._tick >= self._last

    def meant(self, x: float, y: float) -> tuple[int, bool]:
        """Two results for a hand at x, y [m]: the intention's current tick, and whether the intention moves on."""
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
