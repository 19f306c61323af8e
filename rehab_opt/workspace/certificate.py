"""Proof that a spline maps a whole workspace one-to-one into another: bounds between the samples, not only at them.

1. Equilateral triangles cover the source. In each, det J has a positive lower bound and the image stays inside the
target
   (`cell_bounds`); a triangle for which a bound does not hold is cut into four, and those that miss the source are
   dropped.
2. The image of the outline does not meet itself. It is cut into short pieces; each image lies in a disc. Two discs
that meet must
   belong to pieces within one triangle in which the map cannot give two points one image (`turned_back` > 0).

A map with det J > 0 on a closed set bounded by one closed curve, one-to-one on that curve, is one-to-one on the set
(Meisters and Olech, Duke Mathematical Journal 30, 1963). What holds is the polygon of the workspace; how far that is
from the true set is the workspace's `accuracy`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rehab_opt.workspace.cell_bounds import PlaneSpline, cell_bounds, smallest_discs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rehab_opt.workspace.region import Workspace

__all__ = ["Certificate", "certificate", "covering", "examined"]

# Triangles across the square root of the source's area at first, and how often one may be halved.
ACROSS = 24
HALVINGS = 7
# Cells given up when they are so many: the bounds do not close.
MAX_CELLS = 60_000
# A bound is kept as soon as it is this share of the value at the cell's own points; a margin also above this share of
# the size.
KEPT = 0.3
MARGIN_KEPT, WIDE_MARGIN = 0.6, 0.03
# Pieces of the outline at first, how often they are halved, and the reach of the one-to-one triangles in pieces.
PIECES = 800
PIECE_HALVINGS = 4
REACH = 10.0


class Certificate(NamedTuple):
    """What is proven of a map.

    determinant : lower bound of det J over the source [-]; not positive where the proof failed.
    margin : lower bound of the distance of the image from the target's outline [m]; not positive where the proof
        failed.
    outline_simple : whether the outline's image is proven not to meet itself.
    cells : triangles looked at.
    reason : "" or what could not be proven, and where.
    """

    determinant: float
    margin: float
    outline_simple: bool
    cells: int
    reason: str

    @property
    def valid(self) -> bool:
        """Whether the map is proven one-to-one from the source into the target."""
        return self.determinant > 0.0 and self.margin > 0.0 and self.outline_simple and not self.reason


def certificate(spline: PlaneSpline, source: Workspace, target: Workspace) -> Certificate:
    """What can be proven of the spline as a map from one workspace into another."""
    return examined(spline, source, target)[0]


def examined(spline: PlaneSpline, source: Workspace, target: Workspace) -> tuple[Certificate, NDArray[np.float64]]:
    """The certificate, and points (m, 2) [m] of the source around which the proof fails; none where it is valid."""
    cells = covering(source)
    size = np.sqrt(target.area)
    min_determinant = min_margin = np.inf
    looked_at = 0
    for halving in range(HALVINGS + 1):
        looked_at += len(cells)
        bounds = cell_bounds(spline, cells)
        centres, radii = smallest_discs(cells)
        room = -np.atleast_1d(target.distance(spline(centres)))
        margin = room - bounds.stretch * radii
        determinant_kept = (bounds.determinant > 0.0) & (bounds.determinant >= KEPT * bounds.corner_determinant)
        margin_kept = (margin > 0.0) & ((margin >= MARGIN_KEPT * room) | (margin >= WIDE_MARGIN * size))
        kept = determinant_kept & margin_kept
        if kept.any():
            min_determinant = min(min_determinant, float(bounds.determinant[kept].min()))
            min_margin = min(min_margin, float(margin[kept].min()))
        if kept.all():
            meeting = _meeting(spline, source)
            reason = "the image of the outline could not be proven to keep clear of itself" if len(meeting) else ""
            return Certificate(min_determinant, min_margin, not reason, looked_at, reason), meeting
        refuted, at = _refuted(bounds.corner_determinant, room, centres, ~kept, source)
        if refuted or halving == HALVINGS or 4 * (~kept).sum() > MAX_CELLS:
            break
        cells = _touching(_quarters(cells[~kept]), source)
        if not len(cells):
            break
    worst = int(np.argmin(np.where(kept, np.inf, np.minimum(bounds.determinant, margin / size))))
    low = float(np.minimum(bounds.determinant[~kept].min(), min_determinant))
    near = float(np.minimum(margin[~kept].min(), min_margin))
    x, y = centres[worst]
    reason = refuted or f"det J > 0 and containment could not be bounded near ({x:.4f}, {y:.4f}) m"
    return Certificate(low, near, False, looked_at, reason), at if refuted else centres[~kept]


def covering(source: Workspace) -> NDArray[np.float64]:
    """Equilateral triangles (t, 3, 2) [m] that together cover the source; each meets it, or nearly."""
    side = np.sqrt(source.area) / ACROSS
    left, bottom, right, top = source.polygon.bounds
    height = side * np.sqrt(0.75)
    rows = np.arange(int(np.ceil((top - bottom) / height)) + 2)
    columns = np.arange(int(np.ceil((right - left) / side)) + 3)
    i, j = (each.ravel() for each in np.meshgrid(rows, columns, indexing="ij"))

    def node(row: NDArray[np.intp], column: NDArray[np.intp]) -> NDArray[np.float64]:
        return np.column_stack([left - side + side * (column + 0.5 * (row % 2)), bottom - 0.5 * height + height * row])

    odd = i % 2
    up = np.stack([node(i, j), node(i, j + 1), node(i + 1, j + odd)], axis=1)
    down = np.stack([node(i, j + 1 - odd), node(i + 1, j + 1), node(i + 1, j)], axis=1)
    return _touching(np.concatenate([up, down]), source)


def _touching(cells: NDArray[np.float64], source: Workspace) -> NDArray[np.float64]:
    """The cells whose disc meets the source: none that meets it itself is left out."""
    centres, radii = smallest_discs(cells)
    return cells[np.atleast_1d(source.distance(centres)) <= radii * (1.0 + 1e-9) + 1e-12]


def _quarters(cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each triangle as four, (4 t, 3, 2)."""
    a, b, c = (cells[:, k] for k in range(3))
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def _refuted(
    determinant: NDArray[np.float64],
    room: NDArray[np.float64],
    centres: NDArray[np.float64],
    open_: NDArray[np.bool_],
    source: Workspace,
) -> tuple[str, NDArray[np.float64]]:
    """Why no finer cells can help, or "": points (m, 2) of the source that fold or leave the target."""
    inside = open_ & np.atleast_1d(source.contains(centres))
    for values, what in ((room, "is mapped outside the target"), (determinant, "lies where the map folds")):
        bad = inside & ~(values > 0.0)
        if bad.any():
            x, y = centres[np.argmax(bad)]
            return f"({x:.4f}, {y:.4f}) m {what}", centres[bad]
    return "", centres[:0]


def _meeting(spline: PlaneSpline, source: Workspace) -> NDArray[np.float64]:
    """Points (m, 2) [m] of the source's outline around which its image is not proven to keep clear of itself."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)
    from shapely import get_coordinates  # noqa: PLC0415

    outline = source.polygon.exterior
    length = outline.length / PIECES
    for _ in range(PIECE_HALVINGS + 1):
        ends = get_coordinates(outline.segmentize(length))
        middles, halves = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.linalg.norm(np.diff(ends, axis=0), axis=1)
        bounds = cell_bounds(spline, _around(middles, REACH * length))
        images, spread = spline(middles), bounds.stretch * halves * (1.0 + 1e-9)
        pairs = cKDTree(images).query_pairs(2.0 * spread.max(), output_type="ndarray")
        i, j = pairs[:, 0], pairs[:, 1]
        meet = np.linalg.norm(images[i] - images[j], axis=1) <= spread[i] + spread[j]
        i, j = i[meet], j[meet]
        apart = np.linalg.norm(middles[i] - middles[j], axis=1) + np.maximum(halves[i], halves[j])
        alone = (apart <= REACH * length) & ((bounds.turned_back[i] > 0.0) | (bounds.turned_back[j] > 0.0))
        doubtful = ~(bounds.turned_back > 0.0)
        doubtful[i[~alone]] = doubtful[j[~alone]] = True
        if not doubtful.any():
            break
        length /= 2.0
    return np.asarray(middles[doubtful])


def _around(middles: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Equilateral triangles (t, 3, 2) around discs of that radius [m]."""
    angles = np.pi / 2.0 + 2.0 * np.pi / 3.0 * np.arange(3)
    return np.asarray(middles[:, None] + 2.0 * radius * np.column_stack([np.cos(angles), np.sin(angles)]))
