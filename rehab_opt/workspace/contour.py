"""Closed curves at a level of a lattice's distances: marching squares over the nodes that exist."""

from __future__ import annotations

from typing import NamedTuple

from rehab_opt.workspace.lattice import Lattice

__all__ = ["Crossing", "contours", "missing_nodes"]

Key = tuple[int, int]
Edge = tuple[Key, Key]

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Of a cell, counterclockwise."""


class Crossing(NamedTuple):
    """Where the level crosses an edge of the lattice."""

    x: float
    y: float
    outer: Key
    """The edge's node beyond the level."""
    inner: Key


def missing_nodes(lattice: Lattice, level: float) -> list[tuple[Key, Key]]:
    """Nodes not made yet of cells that the level crosses, each with a node of its cell: until there are none."""
    missing: dict[Key, Key] = {}
    for cell in _cells(lattice):
        keys = [(cell[0] + di, cell[1] + dj) for di, dj in CORNERS]
        known = [key for key in keys if key in lattice.nodes]
        if len(known) < 4 and len({lattice.nodes[key].distance < level for key in known}) == 2:
            missing.update((key, known[0]) for key in keys if key not in lattice.nodes)
    return list(missing.items())


def contours(lattice: Lattice, level: float) -> list[list[Crossing]]:
    """Closed curves around what is nearer than `level` [m], which lies on their left."""
    following: dict[Edge, Edge] = {}
    for cell in _cells(lattice):
        keys = [(cell[0] + di, cell[1] + dj) for di, dj in CORNERS]
        if not all(key in lattice.nodes for key in keys):
            continue
        distances = [lattice.nodes[key].distance for key in keys]
        inside = [distance < level for distance in distances]
        if all(inside) or not any(inside):
            continue
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


def _cells(lattice: Lattice) -> list[Key]:
    """Lower left corners of every cell with a node."""
    return sorted({(i - di, j - dj) for i, j in lattice.nodes for di, dj in CORNERS})


def _edge(one: Key, other: Key) -> Edge:
    return (one, other) if one < other else (other, one)


def _crossing(lattice: Lattice, edge: Edge, level: float) -> Crossing:
    inner, outer = sorted(edge, key=lambda key: lattice.nodes[key].distance)
    near, far = lattice.nodes[inner].distance, lattice.nodes[outer].distance
    share = 1.0 if far == near or far == float("inf") else (level - near) / (far - near)
    x, y = (lattice.spacing * (a + share * (b - a)) for a, b in zip(inner, outer, strict=True))
    return Crossing(x, y, outer, inner)
