"""Triangle meshes of planar sets without holes, and grown and shrunk outlines."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rehab_opt.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["PlaneMesh", "cross", "grown", "inradius", "mesh_of", "shrunk", "without_holes"]

# Segments in a quarter of a rounded corner.
ROUNDNESS = 16


class PlaneMesh(NamedTuple):
    """Triangles of one simply connected set.

    points : (n, 2) [m], the `boundary` ones first, counterclockwise and evenly along the outline.
    triangles : (t, 3) indices of points, counterclockwise.
    boundary : number of points on the outline.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.intp]
    boundary: int


def inradius(polygon: Polygon) -> float:
    """Radius [m] of the largest disc inside, to 1 % or better."""
    from shapely import maximum_inscribed_circle  # noqa: PLC0415  (light to import)

    return float(maximum_inscribed_circle(polygon, tolerance=1e-3 * polygon.area**0.5).length)


def grown(polygon: Polygon, by: float) -> Polygon:
    """The set, grown by `by` [m] on all sides, with corner radii of at least `by`.

    Notches are rounded, too, by growing twice as much and shrinking again, which closes narrow ones. Holes that this
    would leave are filled.
    """
    wide = without_holes(polygon.buffer(2.0 * by, quad_segs=ROUNDNESS))
    return without_holes(wide.buffer(-by, quad_segs=ROUNDNESS))


def without_holes(polygon: Polygon) -> Polygon:
    """The set with its holes filled."""
    from shapely import Polygon as Outline  # noqa: PLC0415

    return Outline(polygon.exterior)


def shrunk(polygon: Polygon, by: float) -> Polygon:
    """The points at least `by` [m] from the outline, with convex corners rounded by the same radius.

    If the remaining set falls into pieces, the distance is halved until one piece has at least 90 % of the area.
    """
    while True:
        narrow = polygon.buffer(-2.0 * by, quad_segs=ROUNDNESS).buffer(by, quad_segs=ROUNDNESS)
        if narrow.geom_type == "Polygon" and not narrow.is_empty and not narrow.interiors:
            return narrow
        by /= 2.0
        if not by > 1e-4 * polygon.length:
            raise ConfigurationError("polygon", polygon, "a set that stays in one piece when it is shrunk a little")


def mesh_of(polygon: Polygon, spacing: float) -> PlaneMesh:
    """A mesh with outline points every `spacing` [m] and a hexagonal pattern of the same spacing inside.

    The spacing is halved until every edge of the sampled outline is an edge of the mesh.
    """
    from scipy.spatial import Delaunay  # noqa: PLC0415  (slow to import)
    from shapely import Polygon as Outline  # noqa: PLC0415
    from shapely import contains_xy, get_coordinates  # noqa: PLC0415

    for _ in range(4):
        count = max(16, int(np.ceil(polygon.length / spacing)))
        ring = polygon.exterior if polygon.exterior.is_ccw else polygon.exterior.reverse()
        along = np.arange(count) * (ring.length / count)
        outline = get_coordinates(ring.interpolate(along))
        points = np.concatenate([outline, _hexagonal(polygon.buffer(-0.7 * spacing), spacing)])
        triangles = Delaunay(points).simplices
        centres = points[triangles].mean(axis=1)
        triangles = triangles[contains_xy(Outline(outline), centres[:, 0], centres[:, 1])]
        a, b, c = (points[triangles[:, k]] for k in range(3))
        area = cross(b - a, c - a)
        triangles[area < 0.0] = triangles[area < 0.0][:, ::-1]
        triangles = triangles[np.abs(area) > 1e-6 * spacing**2]  # triangles of three points on one line are dropped
        if _is_disc(triangles, len(points), count):
            return PlaneMesh(points, triangles.astype(np.intp), count)
        spacing /= 2.0
    raise ConfigurationError("polygon", polygon, "an outline whose narrowest part is not much thinner than the set")


def _hexagonal(polygon: Polygon, spacing: float) -> NDArray[np.float64]:
    """Points (n, 2) of a hexagonal pattern inside a set, each `spacing` from its six neighbours."""
    from shapely import contains_xy  # noqa: PLC0415

    if polygon.is_empty:
        return np.empty((0, 2))
    left, bottom, right, top = polygon.bounds
    rows = np.arange(bottom, top, spacing * np.sqrt(0.75))
    columns = np.arange(left - spacing, right + spacing, spacing)
    x = columns[None, :] + 0.5 * spacing * (np.arange(len(rows)) % 2)[:, None]
    y = np.broadcast_to(rows[:, None], x.shape)
    inside = contains_xy(polygon, x, y)
    return np.column_stack([x[inside], y[inside]])


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cross products (...) of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _is_disc(triangles: NDArray[np.intp], points: int, boundary: int) -> bool:
    """Whether the triangles form one disc that uses every point and has exactly the outline as its border."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    kinds, uses = np.unique(edges, axis=0, return_counts=True)
    border = kinds[uses == 1]
    ring = np.sort(np.column_stack([np.arange(boundary), (np.arange(boundary) + 1) % boundary]), axis=1)
    whole = points - len(kinds) + len(triangles) == 1 and len(np.unique(triangles)) == points
    return bool(whole and len(border) == boundary and (np.unique(border, axis=0) == np.unique(ring, axis=0)).all())
