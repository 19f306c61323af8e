"""Signed distance to a polygon's boundary as an expression over a table of its edges: what a tick evaluates.

Every edge is asked, by a few operations on long columns; `EdgeLookup` answers in between, and for arrays of points. The
side of a point is that of the nearest edge. Where that is a corner, or an edge that nearly coincides with another, it
is counted: a ray from inside crosses the boundary an odd number of times.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic.table_size import table_size
from rehab_opt.workspace.edge_table import doubtful_edges, edge_table
from rehab_opt.workspace.region import ON_BOUNDARY

__all__ = ["COLUMNS", "distance_function", "edge_columns", "nearest_point_function"]

COLUMNS = 7
"""Of an edge: its start x, y [m], its vector [m], 1 / length^2 [1/m^2], y of its end [m], whether to count always."""
NEAR = 1e-9
"""[m] Edges nearer than this to one another may be mistaken for each other."""


def edge_columns(polygon: Any) -> NDArray[np.float64]:
    """(size, 7) the edges of a polygon, filled up with edges of no length at the first one's start."""
    edges = edge_table(polygon)
    table = np.zeros((table_size(len(edges)), COLUMNS))
    table[:, [0, 1, 5]] = edges[0, [0, 1, 1]]
    table[: len(edges)] = np.column_stack((edges[:, [0, 1, 2, 3, 4, 9]], doubtful_edges(edges, NEAR)))
    return table


@cache
def distance_function(size: int) -> ca.Function:
    """Point (2,) [m], edges (size, 7) -> signed distance [m], negative inside, and the boundary's nearest point (2,).

    The boundary has no nearest point, NaN, to a point that is no number.
    """
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    start_x, start_y, along_x, along_y, inverse, _, doubtful = ca.horzsplit(table)
    to_x, to_y = point[0] - start_x, point[1] - start_y
    share = ca.fmin(ca.fmax((to_x * along_x + to_y * along_y) * inverse, 0), 1)
    off_x, off_y = to_x - share * along_x, to_y - share * along_y
    squares = off_x * off_x + off_y * off_y
    least = ca.mmin(squares)
    first = ca.find(squares <= least)
    part, x, y = share[first], along_x[first], along_y[first]
    clear = (part > 0) * (part < 1) * (doubtful[first] == 0)
    beside = off_x[first] * y - off_y[first] * x > 0
    inside = ca.Function.if_else("side", _side_of_edge(size), _counted_side(size))(clear, beside, point, table)
    foot = ca.vertcat(start_x[first] + part * x, start_y[first] + part * y)
    return ca.Function(f"edge_distance_{size}", [point, table], [ca.sqrt(least) * (1 - 2 * inside), foot])


def _side_of_edge(size: int) -> ca.Function:
    """Whether a point lies beside its nearest edge, the point, edges -> whether it is inside."""
    inputs = [ca.MX.sym("beside"), ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)]
    return ca.Function("side_of_edge", inputs, [1 - inputs[0]])


def _counted_side(size: int) -> ca.Function:
    """The same from how often a ray crosses the boundary."""
    inputs = [ca.MX.sym("beside"), ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)]
    _, point, table = inputs
    start_x, start_y, along_x, along_y, _, end_y, _ = ca.horzsplit(table)
    begins, ends = start_y <= point[1], end_y <= point[1]
    left = (point[0] - start_x) * along_y < (point[1] - start_y) * along_x
    return ca.Function("counted_side", inputs, [ca.fmod(ca.sum1((begins != ends) * (left == begins)), 2)])


@cache
def nearest_point_function(size: int) -> ca.Function:
    """Point (2,) [m], edges (size, 7) -> the polygon's point (2,) that is nearest: itself inside, see `Workspace`."""
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    distance, foot = distance_function(size)(point, table)
    inside = distance <= ON_BOUNDARY * (1 + ca.fabs(point[0]) + ca.fabs(point[1]))
    return ca.Function(f"nearest_point_{size}", [point, table], [ca.if_else(inside, point, foot)])
