"""The boundary of a slice from curves around it: each vertex is the point of the slice nearest to an outside probe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.contour import Crossing
from rehab_opt.workspace.lattice import Lattice
from rehab_opt.workspace.plane_search import Nearest, PlaneSearch

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

__all__ = ["boundary_ring", "polygon_of_rings"]

Array = NDArray[np.float64]

MAX_STEPS = 400
"""Largest number of vertices added between two neighbours, along a notch."""
SAME, KNOWN = 1e-6, 1.1
"""[m] Tolerance of a known distance; factor on it beyond which a nearest point is rejected."""
THINNEST = 1e-5
"""[m] Parts of a smaller mean width count as curves without area."""


def boundary_ring(search: PlaneSearch, lattice: Lattice, curve: Sequence[Crossing], tolerance: float) -> list[Nearest]:
    """Boundary points in order, from one curve around the slice or around a hole; the slice lies on the curve's left.

    Parameters
    ----------
    tolerance : [m] by which the middle of a chord may leave the slice. If it leaves further, as at a notch narrower
        than the curve's distance, vertices are added on both sides down to the tip.
    """
    feet = [closest for crossing in curve if (closest := _closest(search, lattice, crossing)) is not None]
    ring: list[Nearest] = []
    following = [*feet[1:], *feet[:1]]
    for closest, after, left in zip(feet, following, _chords_leave(search, feet, following, tolerance), strict=True):
        ring.append(closest)
        if left:
            ring.extend(_between(search, closest, after, tolerance))
    return ring


def _chords_leave(
    search: PlaneSearch, starts: Sequence[Nearest], ends: Sequence[Nearest], tolerance: float
) -> NDArray[np.bool_]:
    """(N,) whether each chord's middle may be outside the slice; the middles of short chords are not tested."""
    if not starts:
        return np.zeros(0, dtype=bool)
    middles = np.array([(0.5 * (a.x + b.x), 0.5 * (a.y + b.y)) for a, b in zip(starts, ends, strict=True)])
    leaves = np.ones(len(starts), dtype=bool)
    for side in (starts, ends):
        left = np.flatnonzero(leaves)
        if len(left):
            found = search.approached(middles[left], np.array([side[i].posture for i in left.tolist()]), tolerance)
            leaves[left] = ~(found.distances <= tolerance)
    return leaves


def polygon_of_rings(rings: Sequence[Sequence[Nearest]]) -> BaseGeometry:
    """Polygon or MultiPolygon of the points that an odd number of rings encloses; parts without width are left out."""
    import shapely  # noqa: PLC0415  (heavy)

    whole: BaseGeometry = shapely.Polygon()
    polygons = []
    for ring in rings:
        points = np.array([(closest.x, closest.y) for closest in ring])
        if len(points) >= 3:
            valid = shapely.make_valid(shapely.Polygon(points))
            polygons.append(_surfaces(valid))
    for polygon in sorted(polygons, key=lambda polygon: -polygon.area):
        whole = shapely.symmetric_difference(whole, polygon)
    return _surfaces(whole)


def _surfaces(geometry: BaseGeometry) -> BaseGeometry:
    import shapely  # noqa: PLC0415  (heavy)

    parts = []
    for part in shapely.get_parts(shapely.get_parts(geometry)):
        if part.geom_type == "Polygon" and _wide(part):
            holes = [hole for hole in part.interiors if _wide(shapely.Polygon(hole))]
            parts.append(shapely.Polygon(part.exterior, holes))
    return shapely.union_all(parts)


def _wide(polygon: BaseGeometry) -> bool:
    return bool(polygon.area > THINNEST * polygon.length / 2)


def _closest(search: PlaneSearch, lattice: Lattice, crossing: Crossing) -> Nearest | None:
    """Point of the slice nearest to a point of the curve; None if the search ends further away than known points.

    From the node's posture, the NLP may end in a local minimum millimetres off, which would look like a notch. If the
    answer is further away than a known point, the start is first moved by `PlaneSearch.approached`. If that does not
    help, the answer is left out.
    """
    nodes = [node for key in (crossing.outer, crossing.inner) if (node := lattice.nodes[key]).posture is not None]
    known = min(math.hypot(crossing.x - node.x, crossing.y - node.y) for node in nodes)
    best: Nearest | None = None
    for approached in (False, True):
        for node in nodes:
            assert node.posture is not None
            start = node.posture
            if approached:
                start = search.approached(np.array([[crossing.x, crossing.y]]), start[None]).postures[0]
            answer = search.nearest(crossing.x, crossing.y, start, approached=approached)
            if answer is not None and (best is None or answer.distance < best.distance):
                best = answer
            if best is not None and best.distance <= known + SAME:
                return best
        if best is not None and best.distance <= KNOWN * known:
            return best
    return None


def _between(search: PlaneSearch, first: Nearest, last: Nearest, tolerance: float) -> list[Nearest]:
    done, ahead = [first], [last]
    for _ in range(MAX_STEPS):
        if not ahead:
            break
        inserted = _inserted(search, done[-1], ahead[-1], tolerance)
        if inserted is None:
            done.append(ahead.pop())
        else:
            ahead.append(inserted)
    done.extend(reversed(ahead))
    return done[1:-1]


def _inserted(search: PlaneSearch, a: Nearest, b: Nearest, tolerance: float) -> Nearest | None:
    """A new vertex between two vertices whose chord leaves the slice: the deepest point found in the notch."""
    dx, dy = b.x - a.x, b.y - a.y
    if math.hypot(dx, dy) <= 2 * tolerance:
        return None
    x, y = a.x + dx / 2, a.y + dy / 2
    best = _from_either(search, (x, y), (a, b), tolerance)
    if best is None or best.distance <= tolerance:
        return None
    for fraction in (1.0, 0.5, 0.25):
        deeper = _from_either(search, (x - fraction * dy, y + fraction * dx), (a, b), tolerance)
        if deeper is not None and deeper.distance > tolerance:
            best = deeper
            break
    # A vertex near an old one is dropped: the notch is too narrow.
    known = min(math.hypot(best.x - each.x, best.y - each.y) for each in (a, b))
    return best if known > tolerance / 2 else None


def _from_either(
    search: PlaneSearch, probe: tuple[float, float], ends: tuple[Nearest, Nearest], tolerance: float
) -> Nearest | None:
    best = search.nearest(*probe, ends[0].posture)
    if best is None or best.distance > tolerance:
        other = search.nearest(*probe, ends[1].posture)
        if other is not None and (best is None or other.distance < best.distance):
            best = other
    return best
