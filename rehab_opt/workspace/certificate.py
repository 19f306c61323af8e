"""Proof that a B-spline maps a whole workspace one-to-one into another.

Let D be the source and D' a slightly larger set without holes.

1. det J > 0 all over D'. In a cell the map is bicubic, so det J is a polynomial of degree 5 in each direction. Its
Bernstein coefficients bound it from below, and halving cells sharpens the bound (de Casteljau).

2. Every image of a point on D's outline has exactly one preimage in D'. Consider the image of the outline of D'. Since
det J > 0, a point off this image has as many preimages in D' as the image winds around it (degree of a map). Chords
approximate this image: their polygon does not cross itself, so it winds once around its interior. The image of D's
outline lies in this interior, further from the polygon than the error of the chords.

3. By 2 no two points of D's outline share an image, so by 1 the map is one-to-one on D (Meisters and Olech, Duke
Mathematical Journal 30, 1963), and the image of its outline encloses the image of D.

4. The image of D's outline lies inside the target's outline, at a distance (the margin) from it.

The proof is about the polygons of the workspaces; `accuracy` is their distance from the true sets.
"""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.bspline import PlaneBSpline
from rehab_opt.workspace.triangulation import without_holes

if TYPE_CHECKING:
    from shapely import Polygon

    from rehab_opt.workspace.plane_map import PlaneMap
    from rehab_opt.workspace.region import Workspace

__all__ = ["UNPROVEN", "Certificate", "certificate", "determinant_bounds", "examined", "outline_polygon", "quartered"]

Array = NDArray[np.float64]

GROWN = 0.012
"""D' is D grown by this fraction of sqrt(area)."""
CHORDS = 40_000
"""Number of chords along each outline."""
HALVINGS = 7
"""Largest number of halvings of a cell until its bound is positive."""
KEPT = 0.05
"""A cell is not halved further if its bound of det J is above this fraction of the ratio of areas."""
ROUNDING = 1e-9
"""Least positive bound of det J, relative to the ratio of areas, and least margin, relative to the outline's length."""
MAX_CELLS = 100_000
UNPROVEN = "nothing is proven of the published rule's maps"
TO_BEZIER = np.array([[1.0, 4.0, 1.0, 0.0], [0.0, 4.0, 2.0, 0.0], [0.0, 2.0, 4.0, 0.0], [0.0, 1.0, 4.0, 1.0]]) / 6.0
"""Matrix from coefficients of a cell's four B-splines to its Bernstein coefficients."""
FIRST_HALF = np.array([[comb(r, k) / 2.0**r for k in range(4)] for r in range(4)])
"""Matrix from Bernstein coefficients of a cubic on [0, 1] to those on [0, 1/2]; rotated by 180 degrees, on [1/2, 1]."""


class Certificate(NamedTuple):
    """Proven properties of a map.

    determinant : lower bound of det J over the source [-]; not positive if the proof failed.
    margin : lower bound of the distance of the image from the target's outline [m]; not positive if the proof failed.
    outline_simple : whether the outline's image provably does not touch itself.
    cells : number of examined cells.
    reason : "", or the step of the proof that failed, and where.
    """

    determinant: float
    margin: float
    outline_simple: bool
    cells: int
    reason: str

    @property
    def valid(self) -> bool:
        """Whether the proof succeeded: the whole source is mapped one-to-one into the target."""
        return self.determinant > 0.0 and self.margin > 0.0 and self.outline_simple and not self.reason


class DeterminantBounds(NamedTuple):
    """Bounds of a map's derivatives that hold everywhere in a set."""

    determinant: float
    stretch: float
    cells: int
    doubtful: Array


def certificate(spline: PlaneMap, source: Workspace, target: Workspace) -> Certificate:
    """Try to prove that a map leads one workspace one-to-one into another; both must be in one piece without holes."""
    return examined(spline, source, target)[0]


def examined(spline: PlaneMap, source: Workspace, target: Workspace) -> tuple[Certificate, Array]:
    """Two results: the certificate, and the points (m, 2) [m] without a positive bound of det J."""
    if not isinstance(spline, PlaneBSpline):
        return Certificate(-np.inf, -np.inf, False, 0, UNPROVEN), np.empty((0, 2))
    start, goal = outline_polygon(source), outline_polygon(target)
    around = without_holes(start.buffer(GROWN * start.area**0.5))
    ratio = goal.area / start.area
    bounds = determinant_bounds(spline, around, enough=KEPT * ratio)
    if not bounds.determinant > ROUNDING * ratio:
        at = np.asarray(bounds.doubtful[0] if len(bounds.doubtful) else around.centroid.coords[0])
        reason = f"det J > 0 could not be bounded near ({at[0]:.4f}, {at[1]:.4f}) m"
        return Certificate(min(bounds.determinant, 0.0), -np.inf, False, bounds.cells, reason), bounds.doubtful
    inner, outer = (_chords(spline, each, bounds.stretch) for each in (start, around))
    simple = _encloses(outer, inner)
    inside = goal.contains(inner.polygon)
    margin = (1.0 if inside else -1.0) * goal.exterior.distance(inner.polygon.exterior) - inner.error
    reason = "" if simple else "the image of the outline could not be proven to keep clear of itself"
    if not margin > ROUNDING * goal.length:
        reason = reason or f"the image is {-1e3 * margin:.3g} mm outside the target"
    return Certificate(bounds.determinant, float(margin), simple, bounds.cells, reason), bounds.doubtful


# ------------------------------------------------------------------------------------------------------------ det J
def determinant_bounds(spline: PlaneBSpline, region: Polygon, *, enough: float = 0.0) -> DeterminantBounds:
    """Bounds of the derivatives over a set within the net; cells whose bound exceeds `enough` are not halved.

    A set that leaves the net has no bound.
    """
    import shapely  # noqa: PLC0415  (light to import)

    m, n = spline.cells
    low, size = spline.low, spline.step
    left, bottom, right, top = region.bounds
    if not (left >= low[0] and bottom >= low[1] and right <= low[0] + m * size[0] and top <= low[1] + n * size[1]):
        return DeterminantBounds(-np.inf, np.inf, 0, np.empty((0, 2)))
    shapely.prepare(region)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    window = np.arange(4)
    local = spline.coefficients[i[:, None, None] + window[:, None], j[:, None, None] + window]
    cells, corner = np.einsum("pk,mklc,ql->mpqc", TO_BEZIER, local, TO_BEZIER), low + size * np.column_stack([i, j])
    least, stretch, looked = np.inf, np.inf, 0
    for halving in range(HALVINGS + 1):
        meets = shapely.intersects(region, shapely.box(*corner.T, *(corner + size).T))
        cells, corner = cells[meets], corner[meets]
        looked += len(cells)
        if halving == 0:
            along = [3.0 / size[k] * np.sqrt((np.diff(cells, axis=1 + k) ** 2).sum(-1).max((1, 2))) for k in (0, 1)]
            stretch = float(np.hypot(*along).max())
        bound, at_corners = _smallest_determinants(cells)
        bound, at_corners = bound / size.prod(), at_corners / size.prod()
        kept = bound > (enough if halving < 2 else 0.0)
        least = float(np.minimum(least, bound[kept].min(initial=np.inf)))
        middles = (corner + size / 2.0)[~kept]
        hopeless = halving >= 2 and ((at_corners <= 0.0) & shapely.contains_xy(region, *(corner + size / 2.0).T)).any()
        if not len(middles) or hopeless or halving == HALVINGS or 4 * len(middles) > MAX_CELLS:
            break
        cells, corner = quartered(cells[~kept], corner[~kept], size)
        size = size / 2.0
    if len(middles):
        least = float(np.minimum(bound.min(), 0.0))
    return DeterminantBounds(least, stretch, looked, middles)


def quartered(cells: Array, corner: Array, size: Array) -> tuple[Array, Array]:
    """Split m cells into quarters: their Bernstein coefficients (4 m, 4, 4, ...) and lower left corners."""
    halves = (FIRST_HALF, FIRST_HALF[::-1, ::-1])
    parts = [(i, j) for i in (0, 1) for j in (0, 1)]
    quarters = [np.einsum("pk,mklc,ql->mpqc", halves[i], cells, halves[j]) for i, j in parts]
    return np.concatenate(quarters), np.concatenate([corner + size / 2.0 * part for part in parts])


def _smallest_determinants(cells: Array) -> tuple[Array, Array]:
    """Two results (m,), for each cell: smallest Bernstein coefficient of det J, smallest det J at its corners."""
    along_u, along_v = (3.0 * np.diff(cells, axis=axis) for axis in (1, 2))
    (xu, yu), (xv, yv) = (_scaled(along_u, 2, 3), _scaled(along_v, 3, 2))
    product = np.zeros((len(cells), 6, 6))
    for a in range(3):
        for b in range(4):
            product[:, a : a + 4, b : b + 3] += xu[:, a, b, None, None] * yv - yu[:, a, b, None, None] * xv
    product /= np.outer(_binomials(5), _binomials(5))
    return product.min(axis=(1, 2)), product[:, [0, 0, 5, 5], [0, 5, 0, 5]].min(axis=1)


def _scaled(slopes: Array, p: int, q: int) -> tuple[Array, Array]:
    """Bernstein coefficients of x and of y, times binomials, so that a product of polynomials becomes a convolution."""
    weights = np.outer(_binomials(p), _binomials(q))
    return slopes[..., 0] * weights, slopes[..., 1] * weights


def _binomials(n: int) -> Array:
    return np.array([comb(n, k) for k in range(n + 1)], dtype=float)


# ------------------------------------------------------------------------------------------------------- the outline
class _Chords(NamedTuple):
    """Polygon that approximates the image of an outline: every point of the true image is within `error` [m] of it."""

    polygon: Polygon
    error: float


def _chords(spline: PlaneBSpline, region: Polygon, stretch: float) -> _Chords:
    from shapely import Polygon as Outline  # noqa: PLC0415
    from shapely import get_coordinates  # noqa: PLC0415

    piece = region.exterior.length / CHORDS
    images = spline.evaluate(get_coordinates(region.exterior.segmentize(piece)))[0]
    return _Chords(Outline(images), stretch * piece / 2.0)


def _encloses(outer: _Chords, inner: _Chords) -> bool:
    """Whether the true outer curve provably winds once around every point of the true inner curve."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)
    from shapely import get_coordinates  # noqa: PLC0415

    here, there = (get_coordinates(each.polygon.exterior) for each in (inner, outer))
    clear = cKDTree(there).query(here)[0].min() > 2.0 * (inner.error + outer.error)
    return bool(clear and outer.polygon.is_valid and outer.polygon.contains(inner.polygon))


def outline_polygon(workspace: Workspace) -> Polygon:
    """The polygon of a workspace that is in one piece."""
    polygon = workspace.polygon
    return polygon.geoms[0] if polygon.geom_type == "MultiPolygon" else polygon
