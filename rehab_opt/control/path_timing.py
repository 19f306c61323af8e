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

ALONE = 1e-15
"""Part of the other's coefficient in a row, up to which it bounds the other z alone: it is rounding."""
HALVINGS = 50
"""Of the interval in which the next z is looked for that allows the most before it."""


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
    most, before, after = _bounded(cells, velocity, acceleration)
    # Most cells can be passed from the one bound to the next: there nothing is to be looked for.
    free = np.asarray(np.abs(before * most[:-1, None] + after * most[1:, None]).max(axis=1) <= 1.0)
    back, forth, best = _Lines(before, after), _Lines(after, before), most[1:].copy()
    best[~free] = back.best(~free, best[~free])
    upper, passed, next_best = most.tolist(), free.tolist(), best.tolist()
    top = upper.copy()
    for k in range(len(best) - 1, -1, -1):
        if not passed[k] or top[k + 1] < upper[k + 1]:
            top[k] = min(upper[k], back.largest(k, min(top[k + 1], next_best[k])))
    top[0] = 0.0
    for k in range(len(best)):
        if not passed[k] or top[k] < upper[k]:
            top[k + 1] = min(top[k + 1], forth.largest(k, top[k]))
    speeds = np.sqrt(top)
    both = speeds[:-1] + speeds[1:]
    seconds = np.divide(2.0 * np.diff(cells.knots), both, out=np.full(len(both), np.inf), where=both > 0.0)
    return PathTiming(cells.knots, np.append(0.0, np.cumsum(seconds)), speeds)


class _Lines:
    """Upper bounds x of one of a cell's two z by the other, y, from rows (K, m) of both: |of x + by y| <= 1."""

    def __init__(self, of: Array, by: Array) -> None:
        both = np.abs(of) > ALONE * np.abs(by)
        part = np.where(both, of, 1.0)
        self.at_rest = np.where(both, 1.0 / np.abs(part), np.inf)
        self.slope = np.where(both, by / part, 0.0)
        self.alone = np.where(both, 0.0, np.abs(by)).max(axis=1)

    def largest(self, k: int, y: float) -> float:
        """The k-th cell's greatest x beside y."""
        return max(float(np.minimum.reduce(self.at_rest[k] - self.slope[k] * y)), 0.0)

    def best(self, cells: NDArray[np.bool_], most: Array) -> Array:
        """The y up to `most` (N,) that allow the greatest x in N of the cells.

        What is allowed is convex and contains rest: with y the greatest x rises until there, and then falls.
        """
        at_rest, slope = self.at_rest[cells], self.slope[cells]
        low, high, each = np.zeros_like(most), most, np.arange(len(most))
        for _ in range(HALVINGS):
            y = (low + high) / 2.0
            turned = slope * y[:, None]
            x = at_rest - turned
            first = x.argmin(axis=1)
            rises = (slope[each, first] < 0.0) & (x[each, first] >= np.maximum(-(at_rest + turned).min(axis=1), 0.0))
            rises &= self.alone[cells] * y <= 1.0
            low, high = np.where(rises, y, low), np.where(rises, high, y)
        return low


def _bounded(cells: PathCells, velocity: Array, acceleration: Array) -> tuple[Array, Array, Array]:
    """Upper bounds (K + 1,) of z at the knots, and rows b, a (K, 3 m) with |b z + a (next z)| <= 1, m axes bounded.

    On a cell dq/ds and the acceleration are quadratic in s: their Bernstein coefficients bound them in between.
    """
    length = np.diff(cells.knots)[:, None]
    last = cells.first + cells.second * length + cells.third * length**2 / 2
    steepest = np.maximum.reduce([np.abs(cells.first), np.abs(cells.first + cells.second * length / 2), np.abs(last)])
    fastest = np.minimum((velocity / np.maximum(steepest, 1e-300)).min(axis=1), 1.0) ** 2
    most = np.append(np.minimum(fastest, np.append(fastest[0], fastest[:-1])), 0.0)  # at rest at the end
    bounded = np.isfinite(acceleration)
    first, second, third, last = (each[:, bounded] for each in (*cells[1:], last))
    # With u = (y - x) / (2 length), for z from x to y: at the beginning, the middle coefficient, and at the end.
    start, end = 0.5 * first / length, 0.5 * last / length
    before = np.hstack([second - start, 0.25 * second + 0.5 * third * length - start, -end])
    after = np.hstack([start, start + 0.75 * second, end + second + third * length])
    fraction = np.tile(1.0 / acceleration[bounded], 3)
    return most, before * fraction, after * fraction
