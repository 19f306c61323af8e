"""A one-to-one map between two simply connected sets, through the unit disc, from which a safe map is optimised.

A harmonic map of a set onto a convex set that maps outline to outline is one-to-one (Rado, Kneser, Choquet). So is its
discrete form on a triangle mesh with positive weights (Tutte; Floater 1997). For target sets that are not convex, such
as workspaces, this need not hold. Both sets are therefore mapped onto the unit disc, with outlines spaced by arc
length; the result is the first map followed by the inverse of the second. The free rotation between the discs is chosen
so that pairs on the outlines fit a similarity best.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from rehab_opt.workspace.triangulation import PlaneMesh, cross, mesh_of

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["DiscMap", "disc_map", "harmonic_images", "interpolate", "turns"]

# Approximate number of points of each mesh.
MESH_POINTS = 2500
# Number of rotations of the disc that are compared.
TURNS = 720
# Smallest weight of an edge, relative to that of an edge between equilateral triangles: keeps weights positive in
# floating point.
MIN_WEIGHT = 1e-6
# Number of triangles near a point that are searched for it.
NEIGHBOURS = 32


class DiscMap(NamedTuple):
    """A mesh, and the images (n, 2) of its points under the harmonic map onto the unit disc."""

    mesh: PlaneMesh
    images: NDArray[np.float64]


def harmonic_images(
    source: Polygon, target: Polygon, points: NDArray[np.float64], rotation: float | Literal["best"]
) -> list[NDArray[np.float64]]:
    """Images (n, 2) [m] of source points under harmonic maps onto the target; the best fit first.

    Parameters
    ----------
    source, target : sets without holes [m].
    points : (n, 2) [m], inside the source or on its outline.
    rotation : angle [rad] by which directions turn on average, or "best".

    Returns
    -------
    One array (n, 2) [m] for a given rotation; for "best" one array for each locally best rotation, at most four.
    """
    meshes = [mesh_of(each, float(np.sqrt(each.area / MESH_POINTS))) for each in (source, target)]
    discs = [disc_map(mesh) for mesh in meshes]
    on_disc = interpolate(meshes[0].points, meshes[0].triangles, discs[0].images, points)
    answers = []
    for turn in turns(meshes[0], meshes[1], rotation):
        c, s = np.cos(turn), np.sin(turn)
        turned = on_disc @ np.array([[c, s], [-s, c]])
        answers.append(interpolate(discs[1].images, meshes[1].triangles, meshes[1].points, turned))
    return answers


def disc_map(mesh: PlaneMesh) -> DiscMap:
    """The discrete harmonic map onto the unit disc; outline points are evenly spaced on the circle."""
    from scipy.sparse.linalg import splu  # noqa: PLC0415  (slow to import)

    b = mesh.boundary
    laplacian = _laplacian(mesh)
    angles = 2.0 * np.pi / b * np.arange(b)
    rim = np.column_stack([np.cos(angles), np.sin(angles)])
    inside = splu(laplacian[b:, b:].tocsc()).solve(-(laplacian[b:, :b] @ rim)) if b < len(mesh.points) else rim[:0]
    return DiscMap(mesh, np.concatenate([rim, inside]))


def turns(source: PlaneMesh, target: PlaneMesh, rotation: float | Literal["best"]) -> list[float]:
    """Rotations [rad] of the source's disc for which corresponding outline points fit a similarity best.

    The pairs z, w are centred complex numbers. The residual is least where the sum of conj(z) w has the largest
    component in the direction of the given rotation or, for a free rotation, the largest modulus.
    """
    fraction = np.arange(TURNS) / TURNS
    z, w = (_along(mesh, fraction) for mesh in (source, target))
    fit = np.fft.ifft(np.conj(np.fft.fft(z)) * np.fft.fft(w))  # at k: sum of conj(z_j) w_{j+k}, over TURNS points
    if rotation != "best":
        return [float(2.0 * np.pi * fraction[np.argmax((fit * np.exp(-1j * rotation)).real)])]
    size = np.abs(fit)
    peaks = np.flatnonzero((size >= np.roll(size, 1)) & (size > np.roll(size, -1)))
    best = peaks[np.argsort(-size[peaks])][:4]
    return [float(2.0 * np.pi * fraction[k]) for k in best] or [0.0]


def _along(mesh: PlaneMesh, fraction: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Points at these fractions of the outline's length, as complex numbers whose mean is zero."""
    outline = mesh.points[: mesh.boundary]
    closed = np.concatenate([outline, outline[:1]])
    at = fraction * mesh.boundary
    z = np.interp(at, np.arange(len(closed)), closed[:, 0]) + 1j * np.interp(at, np.arange(len(closed)), closed[:, 1])
    return np.asarray(z - z.mean())


def interpolate(
    points: NDArray[np.float64],
    triangles: NDArray[np.intp],
    images: NDArray[np.float64],
    at: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Images (m, 2) of the points `at` (m, 2) under the piecewise linear map of a mesh from `points` to `images`.

    A point slightly outside the mesh, by rounding or since a chord cuts a curve, is moved into the nearest triangle.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    corners = points[triangles]
    near = cKDTree(corners.mean(axis=1)).query(at, k=min(NEIGHBOURS, len(triangles)))[1].reshape(len(at), -1)
    a, b, c = (corners[near, k] for k in range(3))
    x = at[:, None]
    area = cross(b - a, c - a)
    fractions = np.stack([cross(b - x, c - x), cross(c - x, a - x), cross(a - x, b - x)], axis=-1)
    fractions /= np.where(area > 0.0, area, np.nan)[..., None]
    least = np.where(np.isnan(fractions[..., 0]), -np.inf, fractions.min(axis=-1))
    row, best = np.arange(len(at)), np.argmax(least, axis=1)
    fraction = np.clip(fractions[row, best], 0.0, None)
    fraction /= fraction.sum(axis=1, keepdims=True)
    return np.asarray((images[triangles[near[row, best]]] * fraction[..., None]).sum(axis=1))


def _laplacian(mesh: PlaneMesh):  # type: ignore[no-untyped-def]
    """Laplace matrix with cotangent weights, which on a Delaunay mesh are positive apart from rounding."""
    from scipy.sparse import coo_array, diags_array  # noqa: PLC0415  (slow to import)

    n, rows, columns, weights = len(mesh.points), [], [], []
    for k in range(3):
        i, j, opposite = (mesh.triangles[:, (k + m) % 3] for m in range(3))
        u, v = mesh.points[i] - mesh.points[opposite], mesh.points[j] - mesh.points[opposite]
        rows.append(i)
        columns.append(j)
        weights.append(0.5 * (u * v).sum(axis=1) / cross(u, v))
    half = coo_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)).tocsr()
    edges = half + half.T
    edges.data = np.maximum(edges.data, MIN_WEIGHT)
    return (diags_array(edges.sum(axis=1)) - edges).tocsr()
