"""Signed distance to a polygon's boundary as an expression over a table of its edges, for use in a tick.

It evaluates every edge, by a few operations on long columns; `Workspace` serves arrays of points. The nearest edge
decides the side of a point, at a corner the sum of both edges' normals (Baerentzen and Aanaes, 2005). If edges nearly
coincide, rounding may select the wrong one, so crossings of a ray are counted.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.compiled import table_size
from rehab_opt.workspace.edge_table import doubtful_edges, edge_table
from rehab_opt.workspace.region import ON_BOUNDARY

__all__ = ["COLUMNS", "distance_function", "edge_columns", "nearest_point_function"]

COLUMNS = 11
"""Columns per edge: those of `edge_table`, and a flag for edges whose side must be found by counting crossings."""
NEAR = 1e-9
"""[m] Distance below which rounding may confuse two edges."""


def edge_columns(polygon: Any) -> NDArray[np.float64]:
    """(size, 11) edges of a polygon, padded with edges of zero length at the first one's start."""
    edges = edge_table(polygon)
    table = np.zeros((table_size(len(edges)), COLUMNS))
    table[:, [0, 1, 9]] = edges[0, [0, 1, 1]]
    table[: len(edges)] = np.column_stack((edges, doubtful_edges(edges, NEAR)))
    return table


@cache
def distance_function(size: int) -> ca.Function:
    """Point (2,) [m], edges (size, 11) -> signed distance [m], negative inside, and the boundary's nearest point (2,).

    Both are NaN for a NaN point.
    """
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    start_x, start_y, along_x, along_y, inverse, *_ = ca.horzsplit(table)
    to_x, to_y = point[0] - start_x, point[1] - start_y
    fraction = ca.fmin(ca.fmax((to_x * along_x + to_y * along_y) * inverse, 0), 1)
    off_x, off_y = to_x - fraction * along_x, to_y - fraction * along_y
    squares = off_x * off_x + off_y * off_y
    edge = table[ca.find(squares <= ca.mmin(squares)), :]  # the first of them
    signed, closest = _from_edge()(point, edge)
    argument = ca.MX.sym("signed")
    clear = ca.Function("clear", [argument, point, table], [argument])
    counted = ca.Function("counted", [argument, point, table], [ca.fabs(argument) * _counted_side(size)(point, table)])
    signed = ca.Function.if_else("sided", counted, clear)(edge[COLUMNS - 1], signed, point, table)
    return ca.Function(f"edge_distance_{size}", [point, table], [signed, closest])


@cache
def _from_edge() -> ca.Function:
    """Point (2,), its nearest edge -> signed distance, nearest point (2,); normals point outwards."""
    point, edge = ca.SX.sym("point", 2), ca.SX.sym("edge", COLUMNS)
    start, along, inverse, at_start, at_end = ca.vertsplit(edge, [0, 2, 4, 5, 7, 9, COLUMNS])[:5]
    known = all_true(ca.fabs(point) < ca.inf)
    part = ca.if_else(known, clipped(ca.dot(point - start, along) * inverse, 0, 1), math.nan)
    closest = start + part * along
    off = point - start - part * along
    within = ca.vertcat(along[1], -along[0])
    beside = ca.dot(off, ca.if_else(part <= 0, at_start, ca.if_else(part >= 1, at_end, within))) > 0
    distance = ca.sqrt(ca.sumsqr(off))
    return ca.Function("from_edge", [point, edge], [ca.if_else(beside, distance, -distance), closest], {"cse": True})


def _counted_side(size: int) -> ca.Function:
    """Point, edges -> -1 inside, 1 outside, by counting the edges that a ray crosses."""
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    start_x, start_y, along_x, along_y, *_, end_y, _ = ca.horzsplit(table)
    begins, ends = start_y <= point[1], end_y <= point[1]
    left = (point[0] - start_x) * along_y < (point[1] - start_y) * along_x
    turns = ca.sum1((begins - ends) * (left == begins))
    return ca.Function("counted_side", [point, table], [1 - 2 * turns])


@cache
def nearest_point_function(size: int) -> ca.Function:
    """Point (2,) [m], edges (size, 11) -> nearest point (2,) of the polygon; inside, the point itself."""
    point, table = ca.MX.sym("point", 2), ca.MX.sym("edges", size, COLUMNS)
    distance, closest = distance_function(size)(point, table)
    inside = distance <= ON_BOUNDARY * (1 + ca.fabs(point[0]) + ca.fabs(point[1]))
    return ca.Function(f"nearest_point_{size}", [point, table], [ca.if_else(inside, point, closest)])
