"""Signed distance to a polygon's boundary in about two microseconds: grids whose cells know the edges that matter.

The answer is exact; only the search is cut short. Let c be a cell's centre, h its half-diagonal, d_e the distance of
edge e from c and d the least of them, of edge e0. Distances to two convex sets differ by a function whose slope at p is
the difference of two unit vectors, at most 2 |a - b| / (|p - a| + |p - b|) for the feet a and b (Dunkl and Williams,
1964). With D the largest distance between points of e and e0, no point of the cell is nearer to e than to e0 if

    d_e - d > h min(2, D / (d - h)).

The sign is that of the nearest edge, or at a corner of the sum of both edges' normals (Baerentzen and Aanaes, 2005).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["EdgeLookup"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Edge = tuple[float, float, float, float, float, float, float, float, float]
"""x, y of its start; its vector; 1 / length^2; sums of normals at its start and its end."""

HALVINGS = 7
"""Cells along a grid's side: two to this power."""
REACHES = (2.0, 24.0)
"""Sides of the grids, in sizes of the polygon: a person's hand is often many widths away from a small workspace."""
MOST = 48
"""Edges in a cell's list; where more matter (a boundary of thousands from afar) all are compared at once."""
BEYOND = 1e100
"""[m] counts as infinitely far: its square would be no number."""
ROUNDING = 1e-9
UNKNOWN = -1
"""Status of a cell that the boundary may cross."""


class EdgeLookup:
    """Look-up for a valid polygon that is not empty, of any number of rings.

    Parameters
    ----------
    polygon : shapely Polygon or MultiPolygon. Where its rings touch, the sign at that very corner may be either.
    """

    def __init__(self, polygon: Any) -> None:
        self._table = table = _edge_table(polygon)
        edges: list[Edge] = [tuple(row) for row in table.tolist()]
        self._edges = edges
        low, high = table[:, :2].min(axis=0), table[:, :2].max(axis=0)
        size = float((high - low).max())
        self._cells = 2**HALVINGS
        self._grids: list[tuple[float, float, float, list[list[Edge] | None], list[int]]] = []
        for reach in REACHES:
            corner = (low + high - reach * size) / 2
            pitch = reach * size / self._cells
            lists, status = _filled(table, corner, pitch, polygon)
            known = [None if each is None else [edges[i] for i in each] for each in lists]
            self._grids.append((float(corner[0]), float(corner[1]), 1.0 / pitch, known, status))

    def signed(self, x: float, y: float) -> tuple[float, float, float]:
        """Signed distance [m], negative inside, and x and y of the boundary's nearest point.

        Of an infinite point the distance is infinite, of one that is NaN it is NaN; either has no nearest point: NaN.
        """
        cells = self._cells
        for x0, y0, per_metre, lists, _ in self._grids:
            column, row = (x - x0) * per_metre, (y - y0) * per_metre
            if 0.0 <= column < cells and 0.0 <= row < cells:
                edges = lists[int(row) * cells + int(column)] or self._compared(x, y)
                break
        else:
            edges = self._compared(x, y)
        best = math.inf
        nearest_x = nearest_y = sign = 0.0
        for start_x, start_y, along_x, along_y, inverse, start_nx, start_ny, end_nx, end_ny in edges:
            off_x, off_y = x - start_x, y - start_y
            share = (off_x * along_x + off_y * along_y) * inverse
            if share <= 0.0:
                square = off_x * off_x + off_y * off_y
                if square < best:
                    best, sign = square, off_x * start_nx + off_y * start_ny
                    nearest_x, nearest_y = start_x, start_y
            elif share >= 1.0:
                off_x, off_y = off_x - along_x, off_y - along_y
                square = off_x * off_x + off_y * off_y
                if square < best:
                    best, sign = square, off_x * end_nx + off_y * end_ny
                    nearest_x, nearest_y = start_x + along_x, start_y + along_y
            else:
                off_x, off_y = off_x - share * along_x, off_y - share * along_y
                square = off_x * off_x + off_y * off_y
                if square < best:
                    best, sign = square, off_x * along_y - off_y * along_x
                    nearest_x, nearest_y = start_x + share * along_x, start_y + share * along_y
        distance = math.sqrt(best)
        if distance == math.inf:
            nowhere = math.isnan(x) or math.isnan(y)
            return (math.nan if nowhere else math.inf), math.nan, math.nan
        return (distance if sign > 0.0 else -distance), nearest_x, nearest_y

    def status(self, x: float, y: float) -> int:
        """1 where the cell of the point lies wholly inside, 0 wholly outside, `UNKNOWN` where edges must be asked."""
        cells = self._cells
        for x0, y0, per_metre, _, status in self._grids:
            column, row = (x - x0) * per_metre, (y - y0) * per_metre
            if 0.0 <= column < cells and 0.0 <= row < cells:
                side: int = status[int(row) * cells + int(column)]
                return side
        return UNKNOWN

    def _compared(self, x: float, y: float) -> list[Edge]:
        """The nearest of all edges, with those as near but for rounding; none for what is not finite."""
        if not (abs(x) < BEYOND and abs(y) < BEYOND):
            return []
        square = _squares(self._table, np.array([x]), np.array([y]))
        return [self._edges[i] for i in np.flatnonzero(square <= square.min() * (1 + ROUNDING))]


def _edge_table(polygon: Any) -> Array:
    """(E, 9) an `Edge` a row, of all rings, the interior to the left."""
    import shapely  # noqa: PLC0415  (loaded with the first workspace)

    parts = []
    for part in shapely.get_parts(polygon):
        for ring, wanted in ((part.exterior, True), *((hole, False) for hole in part.interiors)):
            points = shapely.get_coordinates(ring)
            points = points[np.concatenate(([True], np.any(np.diff(points, axis=0) != 0, axis=1)))]
            if bool(shapely.is_ccw(ring)) is not wanted:
                points = points[::-1]
            vector = np.diff(points, axis=0)
            square = (vector**2).sum(axis=1, keepdims=True)
            normal = np.column_stack((vector[:, 1], -vector[:, 0])) / np.sqrt(square)
            at_start = normal + np.roll(normal, 1, axis=0)
            parts.append(np.hstack((points[:-1], vector, 1 / square, at_start, np.roll(at_start, -1, axis=0))))
    return np.concatenate(parts)


def _squares(table: Array, x: Array, y: Array) -> Array:
    """(N,) squared distances of points from edges, row by row; one point stands for all."""
    off_x, off_y = x - table[:, 0], y - table[:, 1]
    share = np.clip((off_x * table[:, 2] + off_y * table[:, 3]) * table[:, 4], 0.0, 1.0)
    squares: Array = (off_x - share * table[:, 2]) ** 2 + (off_y - share * table[:, 3]) ** 2
    return squares


def _filled(table: Array, corner: Array, pitch: float, polygon: Any) -> tuple[list[list[int] | None], list[int]]:
    """The edges that can be nearest to a point of each cell, row by row, and on which side the cell lies."""
    import shapely  # noqa: PLC0415

    middle, half_length = table[:, :2] + table[:, 2:4] / 2, 0.5 / np.sqrt(table[:, 4])
    column = row = np.zeros(len(table), dtype=np.int64)
    edge = np.arange(len(table))
    for halving in range(HALVINGS + 1):
        if halving:  # each cell with its list becomes four
            edge = np.tile(edge, 4)
            column = np.concatenate([2 * column + i for i in (0, 1, 0, 1)])
            row = np.concatenate([2 * row + i for i in (0, 0, 1, 1)])
        side = pitch * 2 ** (HALVINGS - halving)
        key = row * 2**halving + column
        order = np.argsort(key, kind="stable")
        edge, column, row, key = edge[order], column[order], row[order], key[order]
        x, y = corner[0] + (column + 0.5) * side, corner[1] + (row + 0.5) * side
        apart = np.sqrt(_squares(table[edge], x, y))
        first = np.flatnonzero(np.concatenate(([True], np.diff(key) > 0)))
        group = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(key))))
        least = np.minimum.reduceat(apart, first)[group]
        half = side * math.sqrt(0.5) * (1 + ROUNDING)
        nearest = np.zeros(len(first), dtype=np.int64)
        at_least = np.flatnonzero(apart == least)
        nearest[group[at_least]] = edge[at_least]
        rival = nearest[group]
        spread = np.linalg.norm(middle[edge] - middle[rival], axis=1) + half_length[edge] + half_length[rival]
        slope = np.minimum(2.0, spread / np.maximum(least - half, 1e-300))
        kept = apart - least <= half * slope + ROUNDING * least
        edge, column, row, key = edge[kept], column[kept], row[kept], key[kept]
    ends = np.searchsorted(key, np.arange(4**HALVINGS + 1)).tolist()
    listed = edge.tolist()
    lists = [listed[a:b] if b - a <= MOST else None for a, b in pairwise(ends)]
    rows, columns = np.divmod(np.arange(4**HALVINGS), 2**HALVINGS)
    inside = shapely.contains_xy(polygon, corner[0] + (columns + 0.5) * pitch, corner[1] + (rows + 0.5) * pitch)
    return lists, np.where(least[first] > half, inside.astype(int), UNKNOWN).tolist()
