"""How fast a path may be passed: the greatest speed of its parameter that all axes can follow, from rest to rest.

Along q(s), with z the square of the parameter's speed and u = (dz/ds)/2 its acceleration,

    q' = (dq/ds) sqrt(z),    q'' = (dq/ds) u + (d2q/ds2) z,

so that each bound is linear in z and u; z is taken as linear within a cell. The greatest z is found in two passes
(Bobrow, Dubowsky, Gibson 1985; Pham and Pham 2018): backwards, from which z the end can still be reached; then
forwards, as much of that as the acceleration allows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PathCells", "PathTiming", "fastest_timing"]

Array = NDArray[np.float64]

TRIED = np.linspace(0.0, 1.0, 17)
"""Shares of what the next knot allows that are tried at once; what lies between two of them is tried again."""


class PathCells(NamedTuple):
    """K cells of a path of n axes, on each of which q(s) is a cubic."""

    knots: Array
    """(K + 1,) ends of the cells, increasing."""
    first: Array
    """(K, n) dq/ds at the beginning of each cell."""
    second: Array
    """(K, n) d2q/ds2 there."""
    third: Array
    """(K, n) d3q/ds3 on the cell."""


class PathTiming(NamedTuple):
    """When the path's parameter is where."""

    knots: Array
    """(K + 1,) of the path's parameter s."""
    times: Array
    """(K + 1,) [s] from the beginning."""
    speeds: Array
    """(K + 1,) of the parameter [1/s x s's unit]; its square is linear in s on each cell."""

    def at(self, times: Array) -> Array:
        """(M,) the parameter at these times [s]; afterwards the path's end."""
        when = np.minimum(times, self.times[-1])
        k = np.clip(np.searchsorted(self.times, when, side="right") - 1, 0, len(self.times) - 2)
        since, length = when - self.times[k], np.diff(self.knots)[k]
        gain = (self.speeds[k + 1] ** 2 - self.speeds[k] ** 2) / (4.0 * length)
        return np.asarray(self.knots[k] + np.clip(self.speeds[k] * since + gain * since**2, 0.0, length))


def fastest_timing(cells: PathCells, *, velocity: Array, acceleration: Array) -> PathTiming:
    """The greatest speed of the parameter, at most 1, within the axes' bounds (n,) at every instant.

    It takes for ever (inf) where a cell would have to be passed from rest to rest.
    """
    least, rows = _bounded(cells, velocity, acceleration)
    most = np.append(least, 0.0)  # of z: at rest at the end
    # Most cells can be passed from the one bound to the next: there nothing is to be looked for.
    free = (np.abs(rows @ np.stack([most[:-1], most[1:]], axis=1)[:, :, None]) <= 1.0).all(axis=(1, 2)).tolist()
    top = most.copy()
    for k in range(len(rows) - 1, -1, -1):
        if not free[k] or top[k + 1] < most[k + 1]:
            top[k] = _most_before(rows[k], least[k], top[k + 1])
    top[0] = 0.0
    for k in range(len(rows)):
        if not free[k] or top[k] < most[k]:
            top[k + 1] = min(top[k + 1], _most_after(rows[k], top[k]))
    speeds = np.sqrt(top)
    both = speeds[:-1] + speeds[1:]
    seconds = np.divide(2.0 * np.diff(cells.knots), both, out=np.full(len(both), np.inf), where=both > 0.0)
    return PathTiming(cells.knots, np.append(0.0, np.cumsum(seconds)), speeds)


def _bounded(cells: PathCells, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
    """Upper bounds (K,) of z at the beginnings of cells, and rows (K, 3 n, 2) r with |r . (z, next z)| <= 1.

    On a cell dq/ds and the acceleration are quadratic in s: their Bernstein coefficients bound them in between.
    """
    first, second, third = cells.first, cells.second, cells.third
    length = np.diff(cells.knots)[:, None]
    steepest = np.maximum.reduce([np.abs(first), np.abs(first + second * length / 2),
                                  np.abs(first + second * length + third * length**2 / 2)])  # fmt: skip
    fastest = np.minimum((velocity / np.maximum(steepest, 1e-300)).min(axis=1), 1.0) ** 2
    least = np.minimum(fastest, np.append(fastest[0], fastest[:-1]))
    # With u = (y - x) / (2 length), for z from x to y: at the beginning, the middle coefficient, and at the end.
    gain = np.array([-0.5, 0.5]) / length[..., None]
    here, there = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    start = first[..., None] * gain + second[..., None] * here
    slope = third[..., None] * here + 3.0 * second[..., None] * gain
    last = first + second * length + third * length**2 / 2
    end = last[..., None] * gain + (second + third * length)[..., None] * there
    rows = np.concatenate([start, start + 0.5 * length[..., None] * slope, end], axis=1)
    return least, rows / np.tile(acceleration, 3)[:, None]


def _most_before(rows: Array, most: float, top: float) -> float:
    """The greatest z, at most `most`, from which some z up to `top` can be reached by the end of the cell."""
    x, y = rows[:, 0], rows[:, 1]
    if np.abs(x * most + y * top).max() <= 1.0:
        return most
    bent = x != 0.0
    if not bent.all():
        top = min(top, 1.0 / max(float(np.abs(y[~bent]).max()), 1e-300))
    ratio, width = (y[bent] / x[bent])[:, None], 1.0 / np.abs(x[bent])[:, None]
    low, high, found = 0.0, top, 0.0
    for _ in range(5):
        tried = low + (high - low) * TRIED
        upper = np.minimum((width - ratio * tried).min(axis=0), most)
        lower = (-width - ratio * tried).max(axis=0)
        upper = np.where(upper >= np.maximum(lower, 0.0), upper, -1.0)
        best = int(upper.argmax())
        found = max(found, float(upper[best]))
        low, high = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    return found


def _most_after(rows: Array, z: float) -> float:
    """The greatest z that can be reached by the end of a cell from this one."""
    x, y = rows[:, 0], rows[:, 1]
    return float(np.min((1.0 - np.sign(y) * x * z) / np.maximum(np.abs(y), 1e-300)))
