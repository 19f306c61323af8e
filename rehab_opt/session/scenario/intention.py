"""What a person means to do in a trial: places over time, in the robot's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Intention", "held", "nearest_next", "reached", "traced"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Intention:
    """An intended motion, tick by tick.

    Attributes
    ----------
    places, velocities : (N, 2) [m], [m/s].
    goal : (N,) which of `goals` is meant.
    goals : (M, 2) [m] points to be reached or held.
    active : (N,) ticks that count: a goal is to be held, not approached.
    """

    places: Array
    velocities: Array
    goal: NDArray[np.int64]
    goals: Array
    active: NDArray[np.bool_]


def minimum_jerk(share: ArrayLike) -> Array:
    """Share of the way at a share of the time: 10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan 1985)."""
    u = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    way: Array = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
    return way


def reached(path: Array, *, seconds: float, rest: float, dt: float) -> Intention:
    """Along a path (M, 2) [m] to its end by a minimum-jerk motion of its length, then at rest there for `rest` [s]."""
    time = dt * np.arange(math.ceil((seconds + rest) / dt))
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    along = travelled[-1] * minimum_jerk(time / seconds)
    places = np.column_stack([np.interp(along, travelled, path[:, axis]) for axis in (0, 1)])
    everywhere = np.ones(len(time), dtype=bool)
    return Intention(places, _velocities(places, dt), np.zeros(len(time), dtype=np.int64), path[-1:], everywhere)


def traced(path: Array, *, seconds: float, rest: float, dt: float) -> Intention:
    """Along samples (M, 2) [m] that are equal times apart in `seconds`, then rests at the last."""
    time = dt * np.arange(math.ceil((seconds + rest) / dt))
    at = np.linspace(0.0, seconds, len(path))
    places = np.column_stack([np.interp(time, at, path[:, axis]) for axis in (0, 1)])
    everywhere = np.ones(len(time), dtype=bool)
    return Intention(places, _velocities(places, dt), np.zeros(len(time), dtype=np.int64), path[-1:], everywhere)


def held(points: Array, *, move: float, dwell: float, dt: float) -> Intention:
    """From point to point (M, 2) [m] by minimum-jerk motions of `move` [s], each held for `dwell` [s].

    It begins at the first. A point counts from when the hand should be there.
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
    """The points (M, 2) in the order in which each is followed by the nearest that was not visited; the first stays."""
    left = list(range(1, len(points)))
    order = [0]
    while left:
        away = np.linalg.norm(points[left] - points[order[-1]], axis=1)
        order.append(left.pop(int(np.argmin(away))))
    return points[order]


def _velocities(places: Array, dt: float) -> Array:
    return np.gradient(places, dt, axis=0) if len(places) > 1 else np.zeros_like(places)
