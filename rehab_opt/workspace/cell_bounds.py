"""What the Jacobian of a thin-plate spline can be anywhere in a triangle, from its values at the corners.

The gradient of the kernel U = r^2 ln r^2 is interpolated linearly between a triangle's corners. What that leaves out
is bounded for each landmark apart, by the smaller of two bounds (rho: radius of the smallest disc around the triangle,
d: distance of its centre from the landmark, e any unit vector):

- away from the landmark the second derivative of grad U along e is at most 4 sqrt(2) / r (its parts along and across
  the ray to the landmark are 4 and 8 cos sin of the angle with e, over r), so linear interpolation errs by at most
  (1/2) 4 sqrt(2) / (d - rho) rho^2;
- near it, grad U = 2 x ln(r^2 / R^2) + a linear part that interpolation reproduces, and |x| |ln(r^2 / R^2)| <= (2/e) R
  within R = d + rho of the landmark, so that the error is at most (8/e) (d + rho).

Both hold whatever the triangle, so the sum over the landmarks, each with the length of its weight, bounds the
Frobenius norm of what is left out of the Jacobian.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["CellBounds", "PlaneSpline", "cell_bounds", "smallest_discs"]

# Distances between cells and landmarks held at once.
CHUNK = 1_000_000
FAR, NEAR = 2.0 * np.sqrt(2.0), 8.0 / np.e


class PlaneSpline(Protocol):
    """A map of the plane x -> affine + sum_i weights_i U(|x - source_i|)."""

    @property
    def source(self) -> NDArray[np.float64]:
        """Landmarks (n, 2) [m]."""

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights (n, 2) [1/m]."""

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Images (m, 2) [m] of points (m, 2) [m]."""

    def jacobian(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivatives d image_i / d point_j, (m, 2, 2), at points (m, 2)."""


class CellBounds(NamedTuple):
    """Bounds that hold in the whole of each triangle, (t,) each.

    determinant : lower bound of det J.
    stretch : upper bound of the largest singular value of J.
    turned_back : lower bound of v' Q' J v over unit vectors v, Q the rotation nearest to the mean of J at the corners;
        where it is positive no two points of the triangle share an image.
    corner_determinant : smallest det J at the corners (a value, not a bound).
    """

    determinant: NDArray[np.float64]
    stretch: NDArray[np.float64]
    turned_back: NDArray[np.float64]
    corner_determinant: NDArray[np.float64]


def cell_bounds(spline: PlaneSpline, cells: NDArray[np.float64]) -> CellBounds:
    """Bounds of the spline's Jacobian in triangles, cells (t, 3, 2) [m]."""
    corners = np.moveaxis(spline.jacobian(cells.reshape(-1, 2)).reshape(-1, 3, 2, 2), 1, 0)
    centres, radii = smallest_discs(cells)
    left_out = _left_out(spline, centres, radii) + _rounding(spline, cells)
    at_corners = np.stack([_mixed(J, J) for J in corners])
    between = np.stack([_mixed(corners[k], corners[k - 1]) for k in range(3)])
    size = np.sqrt((corners**2).sum(axis=(2, 3))).max(axis=0)
    # det is a quadratic of the linear interpolant, so its Bernstein coefficients bound it from below.
    determinant = np.minimum(at_corners, between).min(axis=0) - size * left_out - 0.5 * left_out**2
    return CellBounds(
        determinant=determinant,
        stretch=_max_stretch(corners).max(axis=0) + left_out,
        turned_back=_turned_back(corners) - left_out,
        corner_determinant=at_corners.min(axis=0),
    )


def smallest_discs(cells: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres (t, 2) and radii (t,) of discs that hold the triangles; the smallest ones where these are equilateral."""
    centres = cells.mean(axis=1)
    return centres, np.sqrt(((cells - centres[:, None]) ** 2).sum(axis=2)).max(axis=1)


def _left_out(spline: PlaneSpline, centres: NDArray[np.float64], radii: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upper bound (t,) of the Frobenius norm of J minus its linear interpolant."""
    landmarks, weights = spline.source, np.sqrt((spline.weights**2).sum(axis=1))
    out = np.empty(len(centres))
    step = max(1, CHUNK // len(landmarks))
    for k in range(0, len(centres), step):
        rho = radii[k : k + step, None]
        d = np.hypot(*(centres[k : k + step, None, j] - landmarks[None, :, j] for j in range(2)))
        gap = d - rho
        far = np.divide(FAR * rho**2, gap, out=np.full_like(d, np.inf), where=gap > 0.0)
        out[k : k + step] = np.minimum(far, NEAR * (d + rho)) @ weights
    return out


def _rounding(spline: PlaneSpline, cells: NDArray[np.float64]) -> float:
    """Generous bound of what rounding does to J: the sum of its terms' sizes, a few units of rounding for each term."""
    landmarks, weights = spline.source, np.sqrt((spline.weights**2).sum(axis=1))
    reach = float(np.linalg.norm(np.ptp(np.concatenate([cells.reshape(-1, 2), landmarks]), axis=0)))
    # |grad U| = 2 r |ln r^2 + 1| is at most this for r up to `reach`; constant parts of it cancel in the sum over
    # landmarks.
    largest = 2.0 * max(reach * abs(np.log(reach**2) + 1.0), 1.0)
    return float(8.0 * np.finfo(float).eps * (np.log2(len(weights)) + 8.0) * largest * weights.sum())


def _mixed(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half of det(A + B) - det A - det B: det for equal arguments, the Bernstein coefficient on an edge for others."""
    return np.asarray(
        0.5 * (A[:, 0, 0] * B[:, 1, 1] + B[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * B[:, 1, 0] - B[:, 0, 1] * A[:, 1, 0])
    )


def _max_stretch(J: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest singular value of each matrix (..., 2, 2)."""
    mean, half = 0.5 * (J[..., 0, 0] + J[..., 1, 1]), 0.5 * (J[..., 0, 0] - J[..., 1, 1])
    turn, shear = 0.5 * (J[..., 1, 0] - J[..., 0, 1]), 0.5 * (J[..., 1, 0] + J[..., 0, 1])
    return np.asarray(np.hypot(mean, turn) + np.hypot(half, shear))


def _turned_back(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smallest eigenvalue (t,) of the symmetric part of Q' J over the corners (3, t, 2, 2); Q: nearest to the mean."""
    mean = corners.mean(axis=0)
    angle = np.arctan2(mean[:, 1, 0] - mean[:, 0, 1], mean[:, 0, 0] + mean[:, 1, 1])
    c, s = np.cos(angle), np.sin(angle)
    a = c * corners[..., 0, 0] + s * corners[..., 1, 0]
    d = -s * corners[..., 0, 1] + c * corners[..., 1, 1]
    b = 0.5 * (c * corners[..., 0, 1] + s * corners[..., 1, 1] - s * corners[..., 0, 0] + c * corners[..., 1, 0])
    return np.asarray((0.5 * (a + d) - np.hypot(0.5 * (a - d), b)).min(axis=0))
