"""A square grid around a polygon whose cells know the edges that can be nearest, and which side they lie on.

Let c be a cell's centre, h its half-diagonal, d_e the distance of edge e from c and d the least of them, of edge e0.
Distances to two convex sets differ by a function whose slope at p is the difference of two unit vectors, at most
2 |a - b| / (|p - a| + |p - b|) for the feet a and b (Dunkl and Williams, 1964). With D the largest distance between
points of e and e0, no point of the cell is nearer to e than to e0 if

    d_e - d > h min(2, D / (d - h)).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.edge_table import Edge, edge_squares

__all__ = ["ASK", "CELLS", "COMPARE", "INSIDE", "OUTSIDE", "Grid", "Square", "filled_grid"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

HALVINGS = 6
CELLS = 2**HALVINGS
"""Cells along a grid's side."""
ROUNDING = 1e-9
OUTSIDE, INSIDE, COMPARE, ASK = 0, 1, -1, -2
"""Side of a cell: wholly outside, wholly inside, that of the nearest edge, or not even that: ask shapely."""


class Square(NamedTuple):
    """Lower corner and side length [m] of what a grid covers."""

    x: float
    y: float
    length: float


class Grid(NamedTuple):
    """Cells row by row, C = CELLS^2 of them."""

    x: float
    y: float
    per_metre: float
    lists: list[list[Edge] | None]
    """of each cell the edges that can be nearest to a point of it; None: not asked yet, too many, or none known"""
    sides: list[int]
    starts: Integers
    """(C + 1,) where the edges of a cell begin in `edges`; they end where the next cell's begin"""
    edges: Integers
    """rows of the table"""


def filled_grid(
    polygon: Any,
    table: Array,
    doubtful: NDArray[np.bool_],
    *,
    square: Square,
    known: Square | None,
    slack: float,
) -> Grid:
    """Fill a grid by halving cells, each with the edges that its parent could not rule out.

    Parameters
    ----------
    polygon : shapely Polygon or MultiPolygon [m], prepared.
    table, doubtful : its edges (E, 10), and (E,) whose word on sides is not taken.
    square : what to cover.
    known : a part of it whose cells may stay empty, as a finer grid answers there.
    slack : [m] by which rounding may move a point into a neighbouring cell or off the boundary.
    """
    import shapely  # noqa: PLC0415

    half_length = 0.5 / np.sqrt(table[:, 4])
    middle_x, middle_y = (table[:, :2] + table[:, 2:4] / 2).T.copy()
    column = row = np.zeros(1, dtype=np.int64)
    edge, count = np.arange(len(table)), np.array([len(table)])
    for halving in range(HALVINGS + 1):
        if halving:  # each cell becomes four, with its list
            edge, count = np.tile(edge, 4), np.tile(count, 4)
            column = np.concatenate([2 * column + i for i in (0, 1, 0, 1)])
            row = np.concatenate([2 * row + i for i in (0, 0, 1, 1)])
        side = square.length / 2**halving
        x, y = square.x + (column + 0.5) * side, square.y + (row + 0.5) * side
        if known is not None:
            needed = ~_within(x, y, side, known)
            edge = edge[np.repeat(needed, count)]
            x, y, column, row, count = x[needed], y[needed], column[needed], row[needed], count[needed]
        first = np.cumsum(count) - count
        apart = np.sqrt(edge_squares(table, edge, np.repeat(x, count), np.repeat(y, count)))
        least = np.minimum.reduceat(apart, first)
        half = side * math.sqrt(0.5) * (1 + ROUNDING) + slack
        # No slope is above 2: this leaves few pairs for the closer look.
        possible = np.flatnonzero(apart <= np.repeat(least * (1 + ROUNDING) + 2 * half + slack, count))
        edge, apart = edge[possible], apart[possible]
        cell = np.repeat(np.arange(len(count)), count)[possible]
        min_here = least[cell]
        at_least = apart == min_here
        rival = np.empty(len(count), dtype=np.int64)
        rival[cell[at_least]] = edge[at_least]
        rival = rival[cell]
        spread = np.hypot(middle_x[edge] - middle_x[rival], middle_y[edge] - middle_y[rival])
        spread += half_length[edge] + half_length[rival]
        slope = np.minimum(2.0, spread / np.maximum(min_here - half, 1e-300))
        kept = apart - min_here <= half * slope + ROUNDING * min_here + slack
        edge, count = edge[kept], np.bincount(cell[kept], minlength=len(count))
    inside = np.where(shapely.contains_xy(polygon, x, y), INSIDE, OUTSIDE)
    near = np.where(np.logical_or.reduceat(doubtful[edge], np.cumsum(count) - count), ASK, COMPARE)
    cell = row * CELLS + column
    sides, counts = np.full(CELLS**2, ASK), np.zeros(CELLS**2, dtype=np.int64)
    sides[cell], counts[cell] = np.where(least > half, inside, near), count
    edge = edge[np.argsort(np.repeat(cell, count), kind="stable")]
    starts = np.concatenate(([0], np.cumsum(counts)))
    return Grid(square.x, square.y, CELLS / square.length, [None] * CELLS**2, sides.tolist(), starts, edge)


def _within(x: Array, y: Array, side: float, known: Square) -> NDArray[np.bool_]:
    """Whether cells around these centres lie in a square, and not just so."""
    reach = known.length / 2 * (1 - 1e-6) - side / 2
    middle_x, middle_y = known.x + known.length / 2, known.y + known.length / 2
    return np.asarray((np.abs(x - middle_x) < reach) & (np.abs(y - middle_y) < reach))
