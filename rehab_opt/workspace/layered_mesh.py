"""A closed surface through stacked planar sets, by interpolated signed distances and marching cubes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

__all__ = ["MAX_NODES", "SurfaceMesh", "closed_mesh", "edges_of_slabs", "enclosed_volume", "signed_distances"]

Array = NDArray[np.float64]

ON_SURFACE = 1e-6
"""[m] Least distance of a node from the surface, to avoid triangles without area."""
MAX_NODES = 50_000_000
"""Largest number of nodes in a mesh's lattice; each of several arrays then takes 400 MB."""
FAR = 1.0
"""[m] Distance used in an empty layer whose neighbours are empty, too."""


class SurfaceMesh(NamedTuple):
    """A surface made of triangles."""

    vertices: Array
    """(V, 3) [m]"""
    triangles: NDArray[np.int64]
    """(T, 3) counterclockwise from outside."""


def edges_of_slabs(heights: Array) -> Array:
    """(n + 1,) [m] edges of the slabs around n >= 2 layers, halfway between neighbours."""
    middle = (heights[1:] + heights[:-1]) / 2
    return np.concatenate([[2 * heights[0] - middle[0]], middle, [2 * heights[-1] - middle[-1]]])


def signed_distances(polygon: BaseGeometry, points: Array) -> Array:
    """(N,) [m] distances of points (N, 2) to a polygon's boundary, negative inside; infinite if it is empty."""
    import shapely  # noqa: PLC0415  (heavy)

    if polygon.is_empty:
        return np.full(len(points), np.inf)
    boundary = polygon.boundary
    shapely.prepare([polygon, boundary])
    away: Array = shapely.distance(boundary, shapely.points(points))
    return np.where(shapely.contains_xy(polygon, points), -away, away)


def padded(layers: Array) -> Array:
    """(n + 2, ...) finite signed distances: those of the layers (n, ...), and one more layer beyond either end.

    Beyond the ends, and in an empty layer, the neighbour's absolute distances are used, so that the surface closes
    halfway.
    """
    n = len(layers)
    filled = np.concatenate([np.full_like(layers[:1], np.inf), layers, np.full_like(layers[:1], np.inf)])
    result = filled.copy()
    for i in range(n + 2):
        if np.isinf(filled[i]).all():
            near = [np.abs(filled[j]) for j in (i - 1, i + 1) if 0 <= j < n + 2 and np.isfinite(filled[j]).all()]
            result[i] = np.max(near, axis=0) if near else FAR
    return result


def closed_mesh(polygons: Sequence[BaseGeometry], heights: Array, *, spacing: float) -> SurfaceMesh:
    """Surface around n >= 2 layers; every edge belongs to two triangles. It may have several parts and tunnels.

    Parameters
    ----------
    polygons : n polygons, at least one not empty.
    heights : (n,) [m], increasing.
    spacing : [m] of the nodes in a layer; thinner parts are lost.

    Raises
    ------
    ConfigurationError : more than `MAX_NODES` nodes; the error names `accuracy`, which sets the spacing.
    """
    import shapely  # noqa: PLC0415  (heavy)
    from skimage.measure import marching_cubes  # noqa: PLC0415  (heavy)

    west, south, east, north = shapely.total_bounds(list(polygons))
    x = np.arange(west - 2 * spacing, east + 3 * spacing, spacing)
    y = np.arange(south - 2 * spacing, north + 3 * spacing, spacing)
    if len(x) * len(y) * (len(polygons) + 2) > MAX_NODES:
        raise ConfigurationError("accuracy", spacing, f"a coarser one, or fewer heights: {MAX_NODES} nodes at the most")
    nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    layers = np.stack([signed_distances(polygon, nodes).reshape(len(x), len(y)) for polygon in polygons])
    field = padded(layers)
    field = np.where(np.abs(field) < ON_SURFACE, ON_SURFACE, field)
    if not (field < 0).any():
        return SurfaceMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    found, triangles, _, _ = marching_cubes(field, 0.0, gradient_direction="ascent")  # type: ignore[no-untyped-call]
    places = found.astype(np.float64)
    below, above = 2 * heights[0] - heights[1], 2 * heights[-1] - heights[-2]
    levels = np.concatenate([[below], heights, [above]])
    vertices = np.stack(
        [
            x[0] + spacing * places[:, 1],
            y[0] + spacing * places[:, 2],
            np.interp(places[:, 0], np.arange(len(levels)), levels),
        ],
        axis=1,
    )
    mesh = SurfaceMesh(vertices, triangles.astype(np.int64))
    return mesh if enclosed_volume(mesh) >= 0 else SurfaceMesh(vertices, mesh.triangles[:, ::-1].copy())


def enclosed_volume(mesh: SurfaceMesh) -> float:
    """[m^3] volume inside a surface, by the divergence theorem; negative if the triangles face inwards."""
    if not len(mesh.triangles):
        return 0.0
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    a, b, c = (centred[mesh.triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
