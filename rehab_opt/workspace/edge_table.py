"""The boundary of a polygon as a table of edges, and the edges that cannot decide between inside and outside."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["doubtful_edges", "edge_table"]

Array = NDArray[np.float64]

SHORTEST_SQUARE = 1e-200
"""[m^2] Least squared length of an edge; a shorter one has no direction in floating point and is left out."""
SHARP = 0.02
"""[rad] Angle of two edges below which rounding may confuse them, even far from their corner."""


def edge_table(polygon: Any) -> Array:
    """(E, 10) table of a valid polygon, one edge per row; the interior is to the left.

    Columns: x, y of the start; vector; 1 / length^2; sums of the two unit normals at the start and at the end; y of the
    end.
    """
    import shapely  # noqa: PLC0415  (loaded with the first workspace)

    rings = []
    for part in shapely.get_parts(polygon):
        if part.is_empty:
            continue
        for ring, wanted in ((part.exterior, True), *((hole, False) for hole in part.interiors)):
            points = shapely.get_coordinates(ring)
            square = (np.diff(points, axis=0) ** 2).sum(axis=1)
            points = points[:-1][square > SHORTEST_SQUARE]
            if len(points) < 3:
                continue
            if bool(shapely.is_ccw(ring)) is not wanted:
                points = points[::-1]
            ends = np.roll(points, -1, axis=0)
            vector = ends - points
            square = (vector**2).sum(axis=1, keepdims=True)
            normal = np.column_stack((vector[:, 1], -vector[:, 0])) / np.sqrt(square)
            at_start = normal + np.roll(normal, 1, axis=0)
            normals = at_start, np.roll(at_start, -1, axis=0)
            rings.append(np.hstack((points, vector, 1 / square, *normals, ends[:, 1:])))
    return np.concatenate(rings)


def doubtful_edges(table: Array, within: float) -> NDArray[np.bool_]:
    """(E,) whether the nearest edge alone may give the wrong side of a point.

    This is so if an edge other than its two neighbours comes nearer than `within` [m] (touching rings, slivers), and at
    sharp corners. Rounding then decides which edge is nearest, and the two give opposite sides.
    """
    import shapely  # noqa: PLC0415

    # |n + n'| of two unit normals is 2 sin(angle / 2).
    sharp_start = np.hypot(table[:, 5], table[:, 6]) < 2 * math.sin(SHARP / 2)
    sharp_end = np.hypot(table[:, 7], table[:, 8]) < 2 * math.sin(SHARP / 2)
    ends = np.stack((table[:, :2], table[:, :2] + table[:, 2:4]), axis=1)
    edges = shapely.linestrings(ends)
    found = shapely.STRtree(edges).query(edges, predicate="dwithin", distance=within)[0]
    crowded = np.bincount(found, minlength=len(table)) > 3  # itself and its neighbours
    return np.asarray(sharp_start | sharp_end | crowded)
