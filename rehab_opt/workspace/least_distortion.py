"""Landmark images that distort least, posed as an optimisation over the thin-plate spline itself.

With the landmarks in the source fixed, a spline's value and Jacobian at any point are linear in the landmarks' images
Y. So with J_q = J_q(Y) at points q spread over the source, and lengths scaled so that both sets have unit area,

    minimise  sum_q a_q (f(J_q) / 4)^2  +  penalty of the outline  +  penalty of the mean rotation
    f(J) = |J|^2 / det J + (1 + (det J)^2) / det J

f is 4 for a rotation, grows with stretch, squeeze and shear alike, and without bound towards det J = 0: what does not
fold at the start never folds on the way. A start that folds somewhere is unfolded first: 1 / det is replaced by 2 /
(det + sqrt(det^2 + eps^2)), which stays finite, and eps is lowered until nothing folds (Garanzha and others, ACM
Transactions on Graphics 40(4), 2021).

The outline's image is drawn to the target's outline, weakly from inside (so that the whole target is used) and
strongly from outside. Sliding along it costs nothing: the pairing of the outlines is part of what is optimised.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rehab_opt.workspace.descent import descent
from rehab_opt.workspace.outline_pull import OutlinePull

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["Sampled", "distortion", "least_distorted", "sampled"]

# Pull to the outline from inside and from outside, per squared distance over area; the second grows until all is
# inside.
PULL_INSIDE = 150.0
PULL_OUTSIDE = 1000.0
ROUNDS = 8
ROTATION_WEIGHT = 100.0
# What may stay outside of the shrunk target [sqrt(area)], and the share of the distortion one more round must win.
ALLOWED_OUTSIDE = 0.004
# det J from which a map counts as unfolded, and the least eps.
UNFOLDED = 1e-3
MIN_EPS = 1e-4


class Sampled(NamedTuple):
    """A spline's Jacobian and values as linear functions of its landmarks' images; lengths over sqrt(area).

    gradient : (2 m, n): d/dx at all m points, then d/dy.
    fractions : (m,) share of the area of each point.
    outline : (b, n): values at points along the outline.
    before : (b, 2): those points.
    """

    gradient: NDArray[np.float64]
    fractions: NDArray[np.float64]
    outline: NDArray[np.float64]
    before: NDArray[np.float64]

    def jacobians(self, images: NDArray[np.float64]) -> NDArray[np.float64]:
        """D image_i / d point_j at [j, point, i], (2, m, 2)."""
        return np.asarray((self.gradient @ images).reshape(2, -1, 2))


def sampled(
    landmarks: NDArray[np.float64],
    points: NDArray[np.float64],
    fractions: NDArray[np.float64],
    outline: NDArray[np.float64],
) -> Sampled:
    """The spline through landmarks (n, 2), sampled at points (m, 2) and along the outline (b, 2)."""
    n = len(landmarks)
    system = np.zeros((n + 3, n + 3))
    system[:n] = _values(landmarks, landmarks)
    system[n:, :n] = system[:n, n:].T
    cardinal = np.linalg.inv(system)[:, :n]
    dx, dy = _slopes(landmarks, points)
    gradient = np.concatenate([dx @ cardinal, dy @ cardinal])
    return Sampled(gradient, fractions, _values(landmarks, outline) @ cardinal, outline)


def distortion(jacobians: NDArray[np.float64], fractions: NDArray[np.float64], eps: float) -> float:
    """Mean of (f / 4)^2; infinite where a map folds and eps is 0."""
    return _distortion(jacobians, fractions, eps)[0]


def least_distorted(
    spline: Sampled, images: NDArray[np.float64], target: Polygon, rotation: float | None, pull: float = PULL_INSIDE
) -> NDArray[np.float64]:
    """Images (n, 2) of the landmarks after minimisation from the given ones; lengths over sqrt(area).

    Parameters
    ----------
    spline : what is sampled.
    images : where to start, (n, 2).
    target : where the outline's image shall lie.
    rotation : wanted mean rotation [rad]; None: any.
    pull : weight of the pull to the outline from inside.
    """
    outline = OutlinePull(target, spline.outline, spline.before, inside=pull, outside=PULL_OUTSIDE)
    curvature = 0.5 * spline.gradient.T @ (np.tile(spline.fractions, 2)[:, None] * spline.gradient)
    curvature += pull / len(spline.outline) * spline.outline.T @ spline.outline

    def cost(eps: float, Y: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        jacobians = spline.jacobians(Y)
        value, slope = _distortion(jacobians, spline.fractions, eps)
        if not np.isfinite(value):
            return np.inf, Y
        if rotation is not None:
            more, by = _rotation_penalty(jacobians, spline.fractions, rotation)
            value, slope = value + more, slope + by
        more, by = outline(Y)
        return value + more, spline.gradient.T @ slope.reshape(-1, 2) + by

    def min_determinant(Y: NDArray[np.float64]) -> float:
        return float(_determinant(spline.jacobians(Y)).min())

    folded = min_determinant(images)
    eps = 0.0 if folded > UNFOLDED else max(-folded, 1e-2)
    for _ in range(30):
        if eps == 0.0:
            break
        images, _ = descent(partial(cost, eps), images, curvature, steps=12, enough=1e-3)
        folded = min_determinant(images)
        eps = 0.0 if folded > UNFOLDED else max((0.5 if folded > -eps else 0.8) * eps, MIN_EPS)
    if eps > 0.0:
        return images
    for _ in range(ROUNDS):
        images, stopped = descent(partial(cost, 0.0), images, curvature, steps=120, enough=2e-4, keeps=outline.simple)
        if outline.outside(images) <= ALLOWED_OUTSIDE and not stopped:
            break
        if stopped:  # the outline was about to cross itself
            outline.keep_apart()
        else:
            outline.tighten()
    return images


def _distortion(
    J: NDArray[np.float64], fractions: NDArray[np.float64], eps: float
) -> tuple[float, NDArray[np.float64]]:
    """Mean of (f / 4)^2 and its derivative with respect to J, shaped as J."""
    det = _determinant(J)
    if eps == 0.0 and not det.min() > 0.0:
        return np.inf, J
    root = np.sqrt(eps**2 + det**2)
    # (det + root) / 2 and its slope; for det < 0 in the form that does not cancel.
    below = np.where(det > 0.0, 0.5 * (det + root), 0.5 * eps**2 / (root - np.minimum(det, 0.0)))
    below_slope = below / root
    above = 0.25 * ((J**2).sum(axis=(0, 2)) + 1.0 + det**2)
    f = above / below
    by_det = 0.5 * det / below - f * below_slope / below
    cofactors = np.empty_like(J)
    cofactors[0, :, 0], cofactors[1, :, 1] = J[1, :, 1], J[0, :, 0]
    cofactors[0, :, 1], cofactors[1, :, 0] = -J[1, :, 0], -J[0, :, 1]
    slope = (2.0 * fractions * f)[None, :, None] * (0.5 * J / below[None, :, None] + by_det[None, :, None] * cofactors)
    return float(fractions @ f**2), slope


def _rotation_penalty(
    J: NDArray[np.float64], fractions: NDArray[np.float64], rotation: float
) -> tuple[float, NDArray[np.float64]]:
    """Weighted square of the mean of J's part across the wanted rotation, and its derivative with respect to J."""
    c, s = np.cos(rotation), np.sin(rotation)
    across = 0.5 * np.array([[-s, c], [-c, -s]])  # at [j, i], as J is stored
    off = float((across[:, None] * J).sum(axis=(0, 2)) @ fractions)
    return ROTATION_WEIGHT * off**2, 2.0 * ROTATION_WEIGHT * off * fractions[None, :, None] * across[:, None]


def _determinant(J: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(J[0, :, 0] * J[1, :, 1] - J[1, :, 0] * J[0, :, 1])


def _values(landmarks: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Kernel and affine terms (m, n + 3), U = r^2 ln r^2: Eq. (26), limb."""
    r2 = ((points[:, None] - landmarks) ** 2).sum(axis=2)
    return np.column_stack([r2 * np.log(np.maximum(r2, 1e-300)), np.ones(len(points)), points])


def _slopes(
    landmarks: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of `_values` along x and along y, (m, n + 3) each."""
    d = points[:, None] - landmarks
    common = 2.0 * (np.log(np.maximum((d**2).sum(axis=2), 1e-300)) + 1.0)
    one, none = np.ones(len(points)), np.zeros(len(points))
    return (
        np.column_stack([common * d[..., 0], none, one, none]),
        np.column_stack([common * d[..., 1], none, none, one]),
    )
