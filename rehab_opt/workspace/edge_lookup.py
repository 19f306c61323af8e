"""Signed distance to a polygon's boundary in about two microseconds: grids whose cells know the edges that matter.

The answer is exact; only the search is cut short (`edge_cells`). The sign is that of the cell where the boundary does
not cross it; else that of the nearest edge, or at a corner of the sum of both edges' normals (Baerentzen and Aanaes,
2005); and where edges nearly coincide, so that rounding may name the wrong one, that of shapely's exact predicate.

What a point may cost, on the machine of bench/workspace_queries.py: about 0.1 us for each edge of its cell's list and
1.5 us besides; 15 us where more than `MOST` edges matter and beyond the outermost grid, and there 10 ns more for each
edge; 5 us more where shapely is asked. A cell's list is made when a point first lies there, which takes as long again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.edge_cells import ASK, CELLS, INSIDE, OUTSIDE, Grid, Square, filled_grid
from rehab_opt.workspace.edge_table import Edge, doubtful_edges, edge_squares, edge_table

__all__ = ["EdgeLookup"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

REACHES = (1.25, 5.0, 24.0)
"""Sides of the grids, in sizes of the polygon: a person's hand is often many widths away from a small workspace."""
BEYOND = 1e100
"""[m] counts as infinitely far: its square would be no number."""
MOST = 64
"""Edges of a cell that are looked at one by one; where more matter numpy compares them first."""
NOWHERE: Edge = (math.nan,) * 5 + ((math.nan,) * 4,)
"""The nearest edge of what is not finite; its feet are NaN."""
TIED = 1e-9
"""Relative: squares that close to the least are compared again, in order."""
AT_ONCE = 200_000
"""Pairs of a point and an edge that are in memory together."""


class Lists(NamedTuple):
    """For each of N points the edges rows[first : first + length]."""

    rows: Integers
    first: Integers
    length: Integers


class EdgeLookup:
    """Look-up for a polygon of any number of rings, which may touch.

    Parameters
    ----------
    polygon : shapely Polygon or MultiPolygon [m], valid and not empty; it gets prepared.
    tolerance : [m] points as near to the boundary as this are in no cell that counts as wholly inside or outside.
    """

    def __init__(self, polygon: Any, *, tolerance: float) -> None:
        import shapely  # noqa: PLC0415  (loaded with the first workspace)

        shapely.prepare(polygon)
        self._polygon, self._contains_xy = polygon, shapely.contains_xy
        self._table = table = np.asfortranarray(edge_table(polygon))
        self._all = np.arange(len(table))
        self._edges: list[Edge] = [(*row[:5], tuple(row[5:9])) for row in table.tolist()]
        doubtful = doubtful_edges(table, tolerance)
        low, high = table[:, :2].min(axis=0), table[:, :2].max(axis=0)
        size = float((high - low).max())
        grids: list[Grid] = []
        known: Square | None = None
        for reach in REACHES:
            x, y = ((low + high - reach * size) / 2).tolist()
            square = Square(x, y, reach * size)
            grids.append(filled_grid(polygon, table, doubtful, square=square, known=known, slack=2 * tolerance))
            known = square
        self._grids = tuple(grids)

    def distance(self, x: float, y: float) -> float:
        """Signed distance [m], negative inside; infinite for an infinite point, NaN for one that is NaN."""
        square, edge, side = self._nearest(x, y)
        distance = math.sqrt(square)
        if side >= 0:
            return -distance if side == INSIDE else distance
        return distance if self._outside(x, y, edge, side) else -distance

    def signed(self, x: float, y: float) -> tuple[float, float, float]:
        """`distance`, and x and y of the boundary's nearest point: NaN where the point is not finite."""
        square, edge, side = self._nearest(x, y)
        start_x, start_y, along_x, along_y, inverse, _ = edge
        fraction = min(max(((x - start_x) * along_x + (y - start_y) * along_y) * inverse, 0.0), 1.0)
        outside = side == OUTSIDE if side >= 0 else self._outside(x, y, edge, side)
        distance = math.sqrt(square)
        return (distance if outside else -distance), start_x + fraction * along_x, start_y + fraction * along_y

    def _nearest(self, x: float, y: float) -> tuple[float, Edge, int]:
        """Squared distance [m^2], the nearest edge, and the side of the cell."""
        side = OUTSIDE  # so it is beyond all grids
        for x0, y0, per_metre, lists, sides, starts, rows in self._grids:
            column, row = (x - x0) * per_metre, (y - y0) * per_metre
            if 0.0 <= column < CELLS and 0.0 <= row < CELLS:
                cell = int(row) * CELLS + int(column)
                edges = lists[cell] or self._listed(x, y, rows[starts[cell] : starts[cell + 1]], lists, cell)
                side = sides[cell]
                break
        else:
            if not (abs(x) < BEYOND and abs(y) < BEYOND):
                return (math.nan if math.isnan(x) or math.isnan(y) else math.inf), NOWHERE, side
            edges = self._compared(x, y, self._all)
        best, nearest = math.inf, NOWHERE
        for edge in edges:
            start_x, start_y, along_x, along_y, inverse, _ = edge
            off_x, off_y = x - start_x, y - start_y
            fraction = (off_x * along_x + off_y * along_y) * inverse
            if fraction > 0.0:
                if fraction >= 1.0:
                    off_x -= along_x
                    off_y -= along_y
                else:
                    off_x -= fraction * along_x
                    off_y -= fraction * along_y
            square = off_x * off_x + off_y * off_y
            if square < best:
                best, nearest = square, edge
        return best, nearest, side

    def _outside(self, x: float, y: float, edge: Edge, side: int) -> bool:
        """On which side a point is, by its nearest edge or, where that may be the wrong one, by shapely."""
        if side == ASK:
            return not self._contains_xy(self._polygon, x, y)
        start_x, start_y, along_x, along_y, inverse, (start_nx, start_ny, end_nx, end_ny) = edge
        off_x, off_y = x - start_x, y - start_y
        fraction = (off_x * along_x + off_y * along_y) * inverse
        if fraction <= 0.0:
            return off_x * start_nx + off_y * start_ny > 0.0
        if fraction >= 1.0:
            return (off_x - along_x) * end_nx + (off_y - along_y) * end_ny > 0.0
        return (off_x - fraction * along_x) * along_y - (off_y - fraction * along_y) * along_x > 0.0

    def side(self, x: float, y: float) -> int:
        """`INSIDE` or `OUTSIDE` where the whole cell of the point lies there; below zero where edges must be asked.

        A point beyond all grids is outside, and so is what is not finite.
        """
        for x0, y0, per_metre, _, sides, _, _ in self._grids:
            column, row = (x - x0) * per_metre, (y - y0) * per_metre
            if 0.0 <= column < CELLS and 0.0 <= row < CELLS:
                side: int = sides[int(row) * CELLS + int(column)]
                return side
        return OUTSIDE

    def signed_rows(self, points: Array) -> Array:
        """(N, 3) what `signed` says of points (N, 2), to the last bit."""
        answers: Array = np.full((len(points), 3), np.nan)
        answers[~np.isnan(points).any(axis=1), 0] = math.inf
        for grid, chosen, cell in self._located(points):
            if grid is None:
                self._answer_all(answers, points, chosen, np.full(len(chosen), OUTSIDE))
                continue
            first, count, sides = grid.starts[cell], np.diff(grid.starts)[cell], np.asarray(grid.sides)[cell]
            full = count > 0
            self._answer(answers, points, chosen[full], Lists(grid.edges, first[full], count[full]), sides[full])
            self._answer_all(answers, points, chosen[~full], sides[~full])
        return answers

    def side_rows(self, points: Array) -> Integers:
        """(N,) what `side` says of points (N, 2)."""
        sides = np.full(len(points), OUTSIDE)
        for grid, chosen, cell in self._located(points):
            if grid is not None:
                sides[chosen] = np.asarray(grid.sides)[cell]
        return sides

    def _located(self, points: Array) -> Iterator[tuple[Grid | None, Integers, Integers]]:
        """Of each grid the rows of points (N, 2) that it answers, and their cells; last, of None, those beyond all."""
        waiting = np.flatnonzero((np.abs(points) < BEYOND).all(axis=1))
        for grid in self._grids:
            column, row = ((points[waiting] - (grid.x, grid.y)) * grid.per_metre).T
            here = (column >= 0) & (column < CELLS) & (row >= 0) & (row < CELLS)
            yield grid, waiting[here], row[here].astype(np.int64) * CELLS + column[here].astype(np.int64)
            waiting = waiting[~here]
        yield None, waiting, np.zeros_like(waiting)

    def _answer_all(self, answers: Array, points: Array, chosen: Integers, sides: Integers) -> None:
        count = np.full(len(chosen), len(self._all))
        self._answer(answers, points, chosen, Lists(self._all, np.zeros_like(count), count), sides)

    def _answer(self, answers: Array, points: Array, chosen: Integers, lists: Lists, sides: Integers) -> None:
        """Answer the chosen points, each from its list, as many at a time as fit into memory."""
        rows, first, length = lists
        done = 0
        while done < len(chosen):
            more = int(np.searchsorted(np.cumsum(length[done : done + AT_ONCE]), AT_ONCE, side="right"))
            part = slice(done, done + max(more, 1))
            begin = np.cumsum(length[part]) - length[part]
            point = np.repeat(np.arange(len(begin)), length[part])
            edge = rows[np.arange(len(point)) + np.repeat(first[part] - begin, length[part])]
            x, y = points[chosen[part]].T
            squares = edge_squares(self._table, edge, x[point], y[point])
            least = np.minimum.reduceat(squares, begin)
            at_least = np.flatnonzero(squares == least[point])
            winner = edge[at_least[np.unique(point[at_least], return_index=True)[1]]]
            answers[chosen[part]] = self._of_edge(x, y, self._table[winner], sides[part])
            done = part.stop

    def _of_edge(self, x: Array, y: Array, edges: Array, sides: Integers) -> Array:
        """(N, 3) signed distances and feet of points whose nearest edges (N, 10) are known."""
        along_x, along_y = edges[:, 2], edges[:, 3]
        off_x, off_y = x - edges[:, 0], y - edges[:, 1]
        raw = (off_x * along_x + off_y * along_y) * edges[:, 4]
        fraction = np.clip(raw, 0.0, 1.0)
        off_x, off_y = off_x - fraction * along_x, off_y - fraction * along_y
        start, end = raw <= 0.0, raw >= 1.0
        normal_x = np.select((start, end), (edges[:, 5], edges[:, 7]), along_y)
        normal_y = np.select((start, end), (edges[:, 6], edges[:, 8]), -along_x)
        outside = np.where(sides >= 0, sides == OUTSIDE, off_x * normal_x + off_y * normal_y > 0.0)
        asked = sides == ASK
        if asked.any():
            outside[asked] = ~self._contains_xy(self._polygon, x[asked], y[asked])
        distance = np.sqrt(off_x**2 + off_y**2)
        closest_x, closest_y = edges[:, 0] + fraction * along_x, edges[:, 1] + fraction * along_y
        return np.column_stack((np.where(outside, distance, -distance), closest_x, closest_y))

    def _listed(
        self, x: float, y: float, rows: Integers, lists: list[list[Edge] | None], cell: int
    ) -> list[Edge]:  # fmt: skip
        """The edges of a cell, kept from now on in its list, unless they are too many."""
        if not 0 < len(rows) <= MOST:
            return self._compared(x, y, rows if len(rows) else self._all)
        edges = lists[cell] = [self._edges[i] for i in rows.tolist()]
        return edges

    def _compared(self, x: float, y: float, rows: Integers) -> list[Edge]:
        """The nearest edges of those rows."""
        square = edge_squares(self._table, rows, x, y)
        return [self._edges[i] for i in rows[square <= square.min() * (1 + TIED)].tolist()]
