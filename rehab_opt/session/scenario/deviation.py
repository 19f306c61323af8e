"""How far from a path points are, how far along it their nearest points lie, and which way it goes there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Projection", "projected"]

Array = NDArray[np.float64]


class Projection(NamedTuple):
    """Of N points onto a path, segment by segment and so exact."""

    distance: Array
    """(N,) [m] to the nearest point of the path."""
    along: Array
    """(N,) [m] of the path before that point."""
    tangent: Array
    """(N, 2) unit vector along the path there, towards its end; zero where the path is a point."""
    length: float
    """[m] of the whole path."""


def projected(points: Array, path: Array) -> Projection:
    """The nearest places of a path (M, 2) [m] to points (N, 2) [m]."""
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
    share = np.clip(((points - start) * tangent).sum(axis=1), 0.0, length)
    distance = np.linalg.norm(points - start - share[:, None] * tangent, axis=1)
    before = np.concatenate(([0.0], np.cumsum(lengths)))
    return Projection(distance, before[nearest] + share, tangent, float(before[-1]))
