"""Coverage of a path by a hand, and the hand's deviation from it: by nearest points or by points assigned in order.

On a path that crosses itself, the nearest point does not show that the hand left out a loop. The ordered assignment
shows it, because its points never go backwards along the path.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Projection", "covered_in_order", "deviation_in_order", "projected"]

Array = NDArray[np.float64]


class Projection(NamedTuple):
    """Exact projection of N points onto a path, segment by segment."""

    distance: Array
    """(N,) [m] distance to the nearest point of the path."""
    along: Array
    """(N,) [m] length of the path from its start to the nearest point."""
    tangent: Array
    """(N, 2) unit vector along the path at the nearest point, towards the end; zero if the path is a point."""
    length: float
    """[m] length of the whole path."""


def projected(points: Array, path: Array) -> Projection:
    """Points on a path (M, 2) [m] nearest to points (N, 2) [m]."""
    import shapely  # noqa: PLC0415

    kept = np.concatenate(([True], np.any(np.diff(path, axis=0) != 0, axis=1)))
    corners = path[kept]
    if len(corners) == 1:
        away = np.linalg.norm(points - corners[0], axis=1)
        return Projection(away, np.zeros(len(points)), np.zeros_like(points), 0.0)
    starts, steps = corners[:-1], np.diff(corners, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    segments = shapely.STRtree(shapely.linestrings(np.stack((starts, corners[1:]), axis=1)))
    nearest = segments.query_nearest(shapely.points(points), all_matches=False)[1]
    start, tangent, length = starts[nearest], steps[nearest] / lengths[nearest, None], lengths[nearest]
    fraction = np.clip(((points - start) * tangent).sum(axis=1), 0.0, length)
    distance = np.linalg.norm(points - start - fraction[:, None] * tangent, axis=1)
    before = np.concatenate(([0.0], np.cumsum(lengths)))
    return Projection(distance, before[nearest] + fraction, tangent, float(before[-1]))


SAMPLES = 3000
"""Largest number of a trial's samples that are used, evenly spaced in time."""
PIECES = 1000
"""Number of pieces of a path, of equal lengths."""


def covered_in_order(position: Array, path: Array, *, within: float, jump: float) -> float:
    """Fraction of a path (M, 2) [m] that hand positions (N, 2) [m] covered in order.

    Path points are assigned to the hand's samples in order, each at most `within` [m] from the hand. The result is the
    largest length that such an assignment covers, as a fraction of the path's length. A piece of path longer than
    `jump` [m] between two successive assigned points does not count.
    """
    places, piece = _evenly(path)
    reach = max(1, math.ceil(jump / piece)) if piece > 0 else 1
    number = np.arange(len(places))
    counted = np.full(len(places), -np.inf)  # largest covered length if the hand has reached this place
    counted[0] = 0.0
    behind = np.full(len(places) + reach, -np.inf)
    beside = np.zeros((len(position[:: _stride(position)]), len(places) + 2), dtype=bool)
    beside[:, 1:-1] = _squared_distances(position[:: _stride(position)], places) <= within**2
    edges = np.nonzero(beside[:, 1:] != beside[:, :-1])[1].tolist()  # begin and end of each row's runs
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        entered = counted[first:last].copy()
        if first:
            entered = np.maximum(entered, counted[:first].max())  # after a gap that does not count
        # After a gap that counts: from the places before the run, within reach of each place in the run.
        begin = max(0, first - reach)
        behind[reach + begin : reach + first] = counted[begin:first] - number[begin:first]
        ends = min(last, first + reach)
        best = np.maximum.accumulate(behind[first : first + reach][::-1])[::-1]
        gaps = number[first:ends] + best[: ends - first]
        entered[: ends - first] = np.maximum(entered[: ends - first], gaps)
        counted[first:last] = number[first:last] + np.maximum.accumulate(entered - number[first:last])
    return float(np.clip(counted.max() / (len(places) - 1), 0.0, 1.0))


def deviation_in_order(position: Array, path: Array) -> Array:
    """(N,) [m] distances of hand positions (N, 2) [m] from points of a path (M, 2) [m], assigned in order.

    The assigned points start at the path's start, never go backwards, and have the least sum of squared distances.
    """
    places, _ = _evenly(path)
    hands = position[:: _stride(position)]
    came_from = np.empty((len(hands), len(places)), dtype=np.int32)
    cost = np.full(len(places), np.inf)
    cost[0] = 0.0
    number = np.arange(len(places))
    for t, away in enumerate(_squared_distances(hands, places)):
        least = np.minimum.accumulate(cost)
        came_from[t] = np.maximum.accumulate(np.where(cost <= least, number, 0))
        cost = least + away
    due = np.empty(len(hands), dtype=np.int64)
    at = int(np.argmin(cost))
    for t in range(len(hands) - 1, -1, -1):
        due[t] = at
        at = int(came_from[t, at])
    ticks = np.arange(len(position))
    between = np.interp(ticks, ticks[:: _stride(position)], due)
    along = np.column_stack([np.interp(between, np.arange(len(places)), places[:, axis]) for axis in (0, 1)])
    return np.asarray(np.linalg.norm(position - along, axis=1))


def _squared_distances(hands: Array, places: Array) -> Array:
    x, y = (np.subtract.outer(hands[:, axis], places[:, axis]) for axis in (0, 1))
    x *= x
    y *= y
    x += y
    return np.asarray(x)


def _stride(position: Array) -> int:
    return max(1, -(-len(position) // SAMPLES))


def _evenly(path: Array) -> tuple[Array, float]:
    """Two results: evenly spaced points along a path, and their spacing [m]."""
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    along = np.linspace(0.0, travelled[-1], PIECES + 1)
    places = np.column_stack([np.interp(along, travelled, path[:, axis]) for axis in (0, 1)])
    return places, float(along[1])
