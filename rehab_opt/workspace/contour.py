"""Closed level curves of the distances at a lattice's nodes, by marching squares."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.lattice import Lattice

__all__ = ["Crossing", "contours", "missing_nodes"]

Array = NDArray[np.float64]
Key = tuple[int, int]
Edge = tuple[Key, Key]

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Corners of a cell, counterclockwise."""


class Crossing(NamedTuple):
    """Point where the level curve crosses an edge of the lattice."""

    x: float
    y: float
    outer: Key
    """The edge's node beyond the level."""
    inner: Key


def missing_nodes(lattice: Lattice, level: float) -> list[tuple[Key, Key]]:
    """Pairs for cells that the level curve crosses: a missing node, and the cell's known node nearest to the slice."""
    cells, distances = _crossed(lattice, level)
    lacking = np.isnan(distances).any(axis=1)
    nearest = np.nanargmin(distances[lacking], axis=1)
    missing: dict[Key, Key] = {}
    for (i, j), of_cell, best in zip(cells[lacking].tolist(), distances[lacking], nearest, strict=True):
        known = (i + CORNERS[best][0], j + CORNERS[best][1])
        missing.update(((i + di, j + dj), known) for (di, dj), d in zip(CORNERS, of_cell, strict=True) if math.isnan(d))
    return list(missing.items())


def contours(lattice: Lattice, level: float) -> list[list[Crossing]]:
    """Closed curves on which the distance from the slice is `level` [m]; nearer points lie on their left."""
    following: dict[Edge, Edge] = {}
    for (i, j), distances in zip(*(each.tolist() for each in _crossed(lattice, level)), strict=True):
        if any(map(math.isnan, distances)):
            continue
        keys = [(i + di, j + dj) for di, dj in CORNERS]
        inside = [distance < level for distance in distances]
        # Counterclockwise around the cell, the curve enters where it goes from outside to inside, seen with the
        # inside on its left, and leaves at the next change: unless a saddle's middle joins the inside corners.
        leaves = [_edge(keys[c], keys[(c + 1) % 4]) for c in range(4) if inside[c] and not inside[(c + 1) % 4]]
        enters = [_edge(keys[c], keys[(c + 1) % 4]) for c in range(4) if not inside[c] and inside[(c + 1) % 4]]
        if len(leaves) == 1:
            following[leaves[0]] = enters[0]
            continue
        joined = sum(min(distance, 2 * level) for distance in distances) / 4 < level
        first = 0 if inside[0] else 1  # the first inside corner: leaves[0] follows it
        before = enters if first == 1 else [enters[1], enters[0]]  # the edge by which each inside corner is entered
        following[leaves[0]] = before[1] if joined else before[0]
        following[leaves[1]] = before[0] if joined else before[1]
    return _rings(lattice, level, following)


def _rings(lattice: Lattice, level: float, following: dict[Edge, Edge]) -> list[list[Crossing]]:
    rings = []
    while following:
        first, edge = following.popitem()
        ring = [_crossing(lattice, first, level)]
        while edge != first:
            ring.append(_crossing(lattice, edge, level))
            edge = following.pop(edge)
        rings.append(ring)
    return rings


def _crossed(lattice: Lattice, level: float) -> tuple[NDArray[np.int64], Array]:
    """Two results for cells that the curve crosses: lower left corners (N, 2); distances (N, 4), NaN without a node."""
    keys = np.array(list(lattice.nodes), dtype=np.int64).reshape(-1, 2)
    known = np.array([node.distance for node in lattice.nodes.values()])
    order = np.lexsort(keys.T[::-1])
    keys, known = keys[order], known[order]
    cells = np.unique((keys[:, None] - np.array(CORNERS)).reshape(-1, 2), axis=0)
    base = keys.min(axis=0, initial=0) - 1
    width = int(np.ptp(keys[:, 1])) + 4 if len(keys) else 1
    codes = (keys - base) @ np.array([width, 1])
    asked = (cells[:, None] + np.array(CORNERS) - base) @ np.array([width, 1])
    at = np.minimum(np.searchsorted(codes, asked), len(codes) - 1)
    distances = np.where(codes[at] == asked, known[at], np.nan)
    crossed = (distances < level).any(axis=1) & (distances >= level).any(axis=1)
    return cells[crossed], distances[crossed]


def _edge(one: Key, other: Key) -> Edge:
    return (one, other) if one < other else (other, one)


def _crossing(lattice: Lattice, edge: Edge, level: float) -> Crossing:
    inner, outer = sorted(edge, key=lambda key: lattice.nodes[key].distance)
    near, far = lattice.nodes[inner].distance, lattice.nodes[outer].distance
    fraction = 1.0 if far == near or far == float("inf") else (level - near) / (far - near)
    x, y = (lattice.spacing * (a + fraction * (b - a)) for a, b in zip(inner, outer, strict=True))
    return Crossing(x, y, outer, inner)
