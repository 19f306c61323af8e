"""Signed distance to a polygon's boundary as an expression over a table of its edges, for use in a tick.

The expression evaluates every edge, by a few operations on long columns; for arrays of points, use `Workspace`. A ray
from the point crosses edges upwards and downwards: the difference of their numbers shows whether the point is inside,
also where edges nearly coincide.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic.compiled import table_size
from rehab_opt.workspace.region import ON_BOUNDARY

__all__ = ["COLUMNS", "distance_function", "edge_columns", "nearest_point_function"]

COLUMNS = 6
"""Columns per edge: x, y of the start; vector to the end; 1 / length^2; y of the end."""
SHORTEST_SQUARE = 1e-200
"""[m^2] Least squared length of an edge; a shorter one has no direction in floating point and is left out."""


def edge_columns(polygon: Any) -> NDArray[np.float64]:
    """Table (size, 6) of a valid polygon's edges, whose inside is on the left; edges of length zero fill the table."""
    import shapely  # noqa: PLC0415  (loaded with the first workspace)
    from shapely.geometry.polygon import orient  # noqa: PLC0415

    rows = []
    for part in map(orient, shapely.get_parts(polygon)):
        for ring in (part.exterior, *part.interiors):
            points = shapely.get_coordinates(ring)
            points = points[:-1][(np.diff(points, axis=0) ** 2).sum(axis=1) > SHORTEST_SQUARE]
            ends = np.roll(points, -1, axis=0)
            square = ((ends - points) ** 2).sum(axis=1)
            rows.append(np.column_stack((points, ends - points, 1 / square, ends[:, 1])))
    edges = np.concatenate(rows)
    table = np.zeros((table_size(len(edges)), COLUMNS))
    table[:, [0, 1, 5]] = edges[0, [0, 1, 1]]
    table[: len(edges)] = edges
    return table


@cache
def distance_function(size: int) -> ca.Function:
    """Function (point (2,), edges (size, 6)) -> (signed distance, nearest point (2,) of the boundary), all in m.

    The distance is negative inside. Both are NaN for a NaN point.
    """
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    start_x, start_y, along_x, along_y, inverse, end_y = ca.horzsplit(table)
    known = ca.logic_and(*ca.vertsplit(ca.fabs(point) < ca.inf))
    x, y = ca.vertsplit(ca.if_else(known, point, 0))
    to_x, to_y = x - start_x, y - start_y
    fraction = ca.fmin(ca.fmax((to_x * along_x + to_y * along_y) * inverse, 0), 1)
    off_x, off_y = to_x - fraction * along_x, to_y - fraction * along_y
    squares = off_x * off_x + off_y * off_y
    nearest = ca.find(squares <= ca.mmin(squares))  # the first of them
    begins, left = start_y <= y, to_x * along_y < to_y * along_x
    winding = ca.sum1((begins - (end_y <= y)) * (left == begins))
    off = ca.vertcat(off_x[nearest], off_y[nearest])
    found = ca.vertcat((1 - 2 * winding) * ca.norm_2(off), x - off[0], y - off[1])
    found = ca.if_else(known, found, math.nan)
    return ca.Function(f"edge_distance_{size}", [point, table], [found[0], found[1:]])


@cache
def nearest_point_function(size: int) -> ca.Function:
    """Function (point (2,), edges (size, 6)) -> nearest point (2,) of the polygon; inside, the point itself."""
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    distance, closest = distance_function(size)(point, table)
    inside = distance <= ON_BOUNDARY * (1 + ca.fabs(point[0]) + ca.fabs(point[1]))
    return ca.Function(f"nearest_point_{size}", [point, table], [ca.if_else(inside, point, closest)])
