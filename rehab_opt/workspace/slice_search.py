"""Search one slice: its inside on a coarse lattice, its boundary on a fine one; then check the boundary."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.contour import contours, missing_nodes
from rehab_opt.workspace.lattice import Lattice
from rehab_opt.workspace.outline import boundary_ring, polygon_of_rings
from rehab_opt.workspace.plane_search import Nearest, PlaneSearch

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from shapely.geometry.base import BaseGeometry

__all__ = ["SliceSearch"]

Array = NDArray[np.float64]

COARSEST = 8e-3
"""[m] Default spacing of the nodes inside."""
ACROSS = 24
"""Least number of nodes across a small set."""
FINE = 2.0
"""Largest spacing along the boundary, as a multiple of the accuracy. With 2.0, ten people's slices at 1 mm differed by
at most 0.21 mm from those at 0.25 mm; with 1.5 by 0.16 mm; with 2.7 a wide range missed its accuracy."""
LEVEL = 0.75
"""Distance from the slice, in fine spacings, of the curve whose points are projected to find the boundary."""
CHORD = 0.02
"""Largest distance of a chord outside the slice, as a fraction of the accuracy."""
SIMPLIFIED = 0.05
"""Tolerance of the simplification to fewer vertices, as a fraction of the accuracy."""
FEW, MANY = 3, 24
"""Numbers of further starts for a probe that was not reached; a third of all postures lead to local minima."""
OTHERS = 3
"""Number of further starts for a coarse node."""
GAP = 0.1
"""Least width of a probed gap, as a fraction of the probes' distance; narrower ones are rounded corners."""
PROBES = 1.0
"""Spacing of the probes that check the boundary, as a multiple of the accuracy."""


class _Way(NamedTuple):
    """A line from an outside coarse node to an inside one, and its two fine nodes next to the boundary."""

    outside: tuple[int, int]
    step: tuple[int, int]
    out: int
    into: int
    posture: Array
    """Posture inside, nearest to the crossing."""


class SliceSearch:
    """Searches the inside on a coarse lattice and the boundary on a fine one."""

    def __init__(self, search: PlaneSearch, seeds: list[Nearest], *, accuracy: float, resolution: float | None) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415  (heavy)

        self.search, self.seeds, self.accuracy = search, seeds, accuracy
        points = np.array([(seed.x, seed.y) for seed in seeds])
        extent = float(np.ptp(points, axis=0).max())
        coarse = min(COARSEST if resolution is None else resolution, extent / ACROSS)
        spacing = max(coarse, accuracy / 2)
        self.ratio = math.ceil(spacing / (FINE * accuracy))
        self.fine_spacing = spacing / self.ratio
        self._seed_tree, self._seed_postures = cKDTree(points), np.array([seed.posture for seed in seeds])
        # A posture at the slice has fewer joints at their limits than one that tried to come nearer.
        free = [seed.posture for seed in seeds if seed.distance == 0.0] or [seed.posture for seed in seeds]
        self._others = itertools.cycle(free)
        self.coarse = Lattice(
            search,
            spacing,
            others=lambda x, y: [*self._seeds_at(x, y), *itertools.islice(self._others, OTHERS)],
            spreads=lambda node: node.distance <= spacing,
            max_offers=2 * FEW,
        )
        self.fine = Lattice(
            search,
            self.fine_spacing,
            others=self._inside_of_cell,
            spreads=lambda node: 0.0 < node.distance <= 0.8 * self.fine_spacing,
            max_offers=FEW,
        )
        self._inside: list[tuple[cKDTree, Array]] = []
        """Search trees and postures of the inside nodes of both lattices."""

    def fill(self) -> None:
        """Create the nodes inside and around every part."""
        self.coarse.offer((key, seed.posture) for seed in self.seeds for key in self.coarse.keys_around(seed.x, seed.y))
        self.coarse.spread()

    def surround(self) -> None:
        """Create fine nodes along the boundary: at nearest points, and between inside and outside coarse nodes."""
        outside = [(key, node) for key, node in self.coarse.nodes.items() if node.distance > 0.0]
        self.fine.offer(
            (near, node.posture)
            for _, node in outside if node.posture is not None
            for near in self.fine.keys_around(node.x, node.y)
        )  # fmt: skip
        between = []
        for key, _ in outside:
            for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                other = self.coarse.nodes.get((key[0] + step[0], key[1] + step[1]))
                if other is not None and other.posture is not None and other.distance == 0.0:
                    between.append(_Way(key, step, 0, self.ratio, other.posture))
        self._bisect(between)
        self.close()

    def close(self) -> None:
        """Spread until every level curve is closed."""
        self.fine.spread()
        while missing := missing_nodes(self.fine, LEVEL * self.fine_spacing):
            # Nodes nearer than the level have a posture.
            known = [(key, self.fine.nodes[near].posture) for key, near in missing]
            self.fine.offer((key, posture) for key, posture in known if posture is not None)
            self.fine.spread()

    def polygon(self) -> BaseGeometry:
        """Polygon of the slice, from the fine lattice."""
        self._inside = [tree for lattice in (self.fine, self.coarse) if (tree := _inside_of(lattice)) is not None]
        curves = contours(self.fine, LEVEL * self.fine_spacing)
        rings = [boundary_ring(self.search, self.fine, curve, CHORD * self.accuracy) for curve in curves]
        exact = polygon_of_rings(rings)
        fewer = exact.simplify(SIMPLIFIED * self.accuracy)
        return fewer if fewer.is_valid else exact

    def contradictions(
        self, polygon: BaseGeometry, distance: float, *, deep: float = 0.0
    ) -> tuple[list[tuple[float, float, Array]], int]:
        """Two results: the probes that contradict the polygon, and the number of all probes.

        Probes are at `distance` [m] on either side of the boundary. Gaps too narrow for these are probed, too, if they
        are deeper than `deep` [m].
        """
        wrong, count = [], 0
        for side in (1.0, -1.0):
            ring = polygon.buffer(side * distance).boundary
            spacing = PROBES * self.accuracy * (2 if side > 0 else 1)
            probes = _along(ring, spacing)
            if side > 0:
                probes = np.concatenate([probes, _gaps(polygon, distance, deep)])
            count += len(probes)
            reached, postures = self._reached(probes, FEW if side > 0 else MANY)
            for i in np.flatnonzero(reached != (side < 0)):
                x, y = (float(each) for each in probes[i])
                if reached[i] or not self._reached_after_all(x, y):
                    wrong.append((x, y, postures[i]))
        return wrong, count

    def _reached_after_all(self, x: float, y: float) -> bool:
        """Whether the NLP reaches a probe that `PlaneApproach` missed."""
        probe = np.array([[x, y]])
        answers = (self.search.nearest(x, y, start[0]) for start in self._inside_near(probe) + self._seeds_near(probe))
        return any(answer is not None and answer.distance == 0.0 for answer in answers)

    def _reached(self, probes: Array, others: int) -> tuple[NDArray[np.bool_], Array]:
        """Two results for probes (N, 2): whether each is in the slice (N,), and a posture there or near it (N, k)."""
        near = self._inside_near(probes) + self._seeds_near(probes)
        reached, postures = np.zeros(len(probes), dtype=bool), near[-1].copy()
        for i in range(len(near) + others):
            left = np.flatnonzero(~reached)
            if not len(left):
                break
            starts = near[i][left] if i < len(near) else np.array(list(itertools.islice(self._others, len(left))))
            found = self.search.approached(probes[left], starts, below=0.0)
            there = found.distances == 0.0
            reached[left[there]], postures[left[there]] = True, found.postures[there]
        return reached, postures

    def repair(self, wrong: list[tuple[float, float, Array]]) -> None:
        """Refine the search around contradicting probes."""
        self.fine.max_offers = MANY
        for x, y, posture in wrong:
            self.fine.offer((key, posture) for key in self.fine.keys_around(x, y))
        self.close()

    def _bisect(self, ways: list[_Way]) -> None:
        """Bisect every line down to two neighbouring fine nodes of which one is inside."""
        done = [way for way in ways if way.into - way.out <= 1]
        while ways := [way for way in ways if way.into - way.out > 1]:
            middles = [(way.out + way.into) // 2 for way in ways]
            self._make((way, middle) for way, middle in zip(ways, middles, strict=True))
            for i, (way, middle) in enumerate(zip(ways, middles, strict=True)):
                node = self.fine.nodes[self._fine_key(way, middle)]
                if node.distance == 0.0 and node.posture is not None:
                    ways[i] = way._replace(into=middle, posture=node.posture)
                else:
                    ways[i] = way._replace(out=middle)
            done += [way for way in ways if way.into - way.out <= 1]
        self._make((way, at) for way in done for at in (way.out, way.into))

    def _make(self, places: Iterable[tuple[_Way, int]]) -> None:
        offers = ((self._fine_key(way, at), way.posture) for way, at in places)
        self.fine.offer((key, posture) for key, posture in offers if key not in self.fine.nodes)

    def _fine_key(self, way: _Way, at: int) -> tuple[int, int]:
        return way.outside[0] * self.ratio + way.step[0] * at, way.outside[1] * self.ratio + way.step[1] * at

    def _seeds_at(self, x: float, y: float) -> list[Array]:
        return [postures[0] for postures in self._seeds_near(np.array([[x, y]]))]

    def _seeds_near(self, probes: Array) -> list[Array]:
        """Postures (N, k) of the seeds nearest to the probes (N, 2), then of the second nearest ones."""
        return _nearest_of(self._seed_tree, self._seed_postures, probes)

    def _inside_of_cell(self, x: float, y: float) -> list[Array]:
        """Posture of an inside coarse node nearby; a look-up fast enough for every fine node."""
        for key in self.coarse.keys_around(x, y):
            node = self.coarse.nodes.get(key)
            if node is not None and node.distance == 0.0 and node.posture is not None:
                return [node.posture]
        return []

    def _inside_near(self, probes: Array) -> list[Array]:
        """Postures (N, k) of the inside nodes nearest to the probes (N, 2), the fine ones first.

        From a posture 1 mm off nearly every search succeeds; from elsewhere up to nine in ten end in local minima.
        """
        return [each for tree, postures in self._inside for each in _nearest_of(tree, postures, probes)]


def _inside_of(lattice: Lattice) -> tuple[cKDTree, Array] | None:
    """Two results for a lattice's inside nodes: a search tree of their positions, and their postures."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (heavy)

    inside = [node for node in lattice.nodes.values() if node.distance == 0.0]
    return (cKDTree([(n.x, n.y) for n in inside]), np.array([n.posture for n in inside])) if inside else None


def _nearest_of(tree: cKDTree, postures: Array, probes: Array) -> list[Array]:
    count = min(2, len(postures))
    indices = tree.query(probes, count)[1].reshape(len(probes), count)
    return [postures[column] for column in indices.T]


def _gaps(polygon: BaseGeometry, distance: float, deep: float) -> Array:
    """(N, 2) one point in each hole and notch that is too narrow for probes at `distance` from its sides."""
    import shapely  # noqa: PLC0415  (heavy)

    closed = polygon.buffer(distance).buffer(-distance)
    narrow = shapely.get_parts(closed.difference(polygon))
    probed = [
        part
        for part in narrow
        if part.area > (GAP * distance) ** 2
        and shapely.distance(closed.boundary, shapely.points(shapely.get_coordinates(part))).max() >= deep
    ]
    return np.asarray(shapely.get_coordinates(shapely.point_on_surface(probed)))


def _along(lines: BaseGeometry, spacing: float) -> Array:
    """(N, 2) points along lines, at most `spacing` apart."""
    import shapely  # noqa: PLC0415  (heavy)

    points = [np.zeros((0, 2))]
    for line in shapely.get_parts(lines):
        if line.length > 0:
            at = np.arange(0, line.length, line.length / math.ceil(line.length / spacing))
            points.append(shapely.get_coordinates(shapely.line_interpolate_point(line, at)))
    return np.concatenate(points)
