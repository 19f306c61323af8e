"""The search for one slice: inside on a coarse lattice, the boundary on a fine one along it, then a check."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.contour import contours, missing_nodes
from rehab_opt.workspace.lattice import Lattice, Node
from rehab_opt.workspace.outline import boundary_ring, polygon_of_rings
from rehab_opt.workspace.plane_search import Nearest, PlaneSearch

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from shapely.geometry.base import BaseGeometry

__all__ = ["SliceSearch"]

Array = NDArray[np.float64]

COARSEST = 8e-3
"""[m] Spacing of the nodes inside, by default."""
ACROSS = 24
"""Nodes across a small set, at least."""
LEVEL = 0.75
"""Distance, in fine spacings, of the curve whose nearest points are the boundary."""
CHORD = 0.02
"""Share of the accuracy by which a chord may leave the slice."""
SIMPLIFIED = 0.05
"""Share of the accuracy given up for fewer vertices."""
PROBES = 1.0
"""Spacing of the probes that check the boundary, in accuracies."""


class SliceSearch:
    """Inside by a coarse lattice, the boundary by a fine one along it."""

    def __init__(self, search: PlaneSearch, seeds: list[Nearest], *, accuracy: float, resolution: float | None) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415  (heavy)

        self.search, self.seeds, self.accuracy = search, seeds, accuracy
        points = np.array([(seed.x, seed.y) for seed in seeds])
        extent = float(np.ptp(points, axis=0).max())
        coarse = min(COARSEST, extent / ACROSS) if resolution is None else resolution
        self.fine_spacing = min(accuracy, max(coarse, accuracy / 2))
        self.ratio = max(1, round(coarse / self.fine_spacing))
        spacing = self.ratio * self.fine_spacing
        self._seed_tree = cKDTree(points)
        self.coarse = Lattice(
            search, spacing, others=self._seeds_near, spreads=lambda node: node.distance <= 1.5 * spacing
        )
        self.fine = Lattice(
            search, self.fine_spacing, others=lambda x, y: self._inside_near(x, y)[:1], spreads=self._is_near
        )
        self._coarse_tree: tuple[cKDTree, list[Array]] | None = None

    def fill(self) -> None:
        """Nodes inside and around every part."""
        for seed in self.seeds:
            for key in self.coarse.keys_around(seed.x, seed.y):
                self.coarse.offer(key, seed.posture)
        self.coarse.spread()

    def surround(self) -> None:
        """Fine nodes along the boundary: from nearest points, and where it passes between two coarse nodes."""
        from scipy.spatial import cKDTree  # noqa: PLC0415  (heavy)

        inside = [node for node in self.coarse.nodes.values() if node.distance == 0.0]
        if inside:
            self._coarse_tree = (
                cKDTree([(n.x, n.y) for n in inside]),
                [n.posture for n in inside if n.posture is not None],
            )
        for key, node in self.coarse.nodes.items():
            if node.distance == 0.0 or node.posture is None:
                continue
            for near in self.fine.keys_around(node.x, node.y):
                if near not in self.fine.nodes:
                    self.fine.offer(near, node.posture)
            for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                other = self.coarse.nodes.get((key[0] + step[0], key[1] + step[1]))
                if other is not None and other.distance == 0.0:
                    self._approach(key, step, other)
        self.close()

    def close(self) -> None:
        """Spread until the level's curves are closed."""
        self.fine.spread()
        while missing := missing_nodes(self.fine, LEVEL * self.fine_spacing):
            for key, known in missing:
                posture = self.fine.nodes[known].posture
                if posture is not None:
                    self.fine.offer(key, posture)
            self.fine.spread()

    def polygon(self) -> BaseGeometry:
        """The set, as the fine lattice knows it now."""
        curves = contours(self.fine, LEVEL * self.fine_spacing)
        rings = [boundary_ring(self.search, self.fine, curve, CHORD * self.accuracy) for curve in curves]
        return polygon_of_rings(rings).simplify(SIMPLIFIED * self.accuracy)

    def contradictions(self, polygon: BaseGeometry, distance: float) -> tuple[list[tuple[float, float, Array]], int]:
        """Probes at `distance` on either side that are reachable outside or not inside, and how many were made."""
        wrong, count = [], 0
        for side in (1.0, -1.0):
            ring = polygon.buffer(side * distance).boundary
            for x, y in _along(ring, PROBES * self.accuracy * (2 if side > 0 else 1)):
                count += 1
                reached, posture = self._reached(x, y)
                if reached != (side < 0):
                    wrong.append((x, y, posture))
        return wrong, count

    def _reached(self, x: float, y: float) -> tuple[bool, Array]:
        starts = [*self._inside_near(x, y), *self._seeds_near(x, y)]
        for posture in starts:
            answer = self.search.nearest(x, y, posture)
            if answer is not None and answer.distance == 0.0:
                return True, answer.posture
        return False, starts[0]

    def repair(self, wrong: list[tuple[float, float, Array]]) -> None:
        """Look closer around probes that contradicted."""
        for x, y, posture in wrong:
            for key in self.fine.keys_around(x, y):
                self.fine.offer(key, posture)
        self.close()

    def _approach(self, key: tuple[int, int], step: tuple[int, int], inside: Node) -> None:
        """Fine nodes on the way from a coarse node outside to one inside, by bisection."""
        assert inside.posture is not None
        out, into = 0, self.ratio
        posture = inside.posture
        while into - out > 1:
            middle = (out + into) // 2
            fine = (key[0] * self.ratio + step[0] * middle, key[1] * self.ratio + step[1] * middle)
            node = self.fine.nodes.get(fine) or self.fine.offer(fine, posture)
            if node.distance == 0.0 and node.posture is not None:
                into, posture = middle, node.posture
            else:
                out = middle
        for at in (out, into):
            fine = (key[0] * self.ratio + step[0] * at, key[1] * self.ratio + step[1] * at)
            if fine not in self.fine.nodes:
                self.fine.offer(fine, posture)

    def _is_near(self, node: Node) -> bool:
        return 0.0 < node.distance <= 0.8 * self.fine_spacing

    def _seeds_near(self, x: float, y: float) -> list[Array]:
        count = min(3, len(self.seeds))
        indices = np.atleast_1d(self._seed_tree.query((x, y), count)[1])
        return [self.seeds[i].posture for i in indices]

    def _inside_near(self, x: float, y: float) -> list[Array]:
        if self._coarse_tree is None:
            return self._seeds_near(x, y)[:1]
        tree, postures = self._coarse_tree
        indices = np.atleast_1d(tree.query((x, y), min(2, len(postures)))[1])
        return [postures[i] for i in indices]


def _along(lines: BaseGeometry, spacing: float) -> Array:
    """(N, 2) points on lines, at most `spacing` apart."""
    import shapely  # noqa: PLC0415  (heavy)

    points = [np.zeros((0, 2))]
    for line in shapely.get_parts(lines):
        if line.length > 0:
            at = np.arange(0, line.length, line.length / math.ceil(line.length / spacing))
            points.append(shapely.get_coordinates(shapely.line_interpolate_point(line, at)))
    return np.concatenate(points)
