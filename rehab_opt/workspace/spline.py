"""The thin-plate spline of least bending through pairs of landmarks. Section V, Rossa et al."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array
from rehab_opt.workspace.plane_map import PlaneMap
from rehab_opt.workspace.point_arguments import real_number

__all__ = ["ThinPlateSpline"]

Array = NDArray[np.float64]
TINY = 1e-300
"""Added to r^2 in the logarithm so that U(0) = 0; negligible otherwise."""
AFFINE_ROUNDING = 32 * float(np.finfo(np.float64).eps)
"""Relative departure from an affine map that counts as rounding of the landmarks."""
CLOSEST, THINNEST = 1e-7, 1e-8
"""Fractions of the spread: closer landmarks coincide, and a narrower set lies on a line."""
RESIDUAL = 1e-8
"""Largest residual of the fit, as a fraction of the targets' spread."""
CHUNK = 100_000
"""Size of temporary arrays, in numbers."""


@dataclass(frozen=True, eq=False)
class ThinPlateSpline(PlaneMap):
    """g(x, y) = b_0 + b_1 x + b_2 y + sum_i w_i U(|(x, y) - source_i|), U(r) = r^2 ln r^2: Eqs. (24)-(30).

    Parameters
    ----------
    source : (N, 2) landmarks [m], N >= 3, different and not on one line.
    target : (N, 2) images of the landmarks [m]. If they are an affine function of the sources, up to rounding, the
        weights are zero.
    smoothing : lambda >= 0 on the diagonal of K, with lengths in units of the sources' root mean square distance from
        their mean; zero interpolates. scipy's `smoothing` is lambda times half the square of that distance.

    Attributes
    ----------
    weights : (N, 2) w_i [1/m]; they sum to zero, and so do their products with the sources.
    affine : (3, 2) b_0 [m], b_1, b_2.
    bending_energy : the integral (24) over the plane, of both coordinates: 16 pi sum_c w_c' K w_c.

    Raises
    ------
    ConfigurationError : invalid `source`, `target` or `smoothing`; the error names the argument and, if possible, the
        landmark.
    """

    source: Array
    target: Array
    smoothing: float = 0.0
    weights: Array = field(init=False)
    affine: Array = field(init=False)
    bending_energy: float = field(init=False)
    _frame: tuple[Array, float, Array, Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Solve Eq. (29) with landmarks centred and scaled, for good conditioning."""
        source, target = _landmarks("source", self.source), _landmarks("target", self.target)
        if len(source) != len(target):
            raise ConfigurationError("target", self.target, f"as many landmarks as the source has, {len(source)}")
        smoothing = real_number(self.smoothing)
        if not 0.0 <= smoothing < math.inf:
            raise ConfigurationError("smoothing", self.smoothing, "a finite number, zero or positive")
        centre, scale, s, square = _unit_spread(source)
        K = square * np.log(square + TINY)
        w, b = _solved(K + smoothing * np.eye(len(s)), s, target, source, scale)
        if (
            not np.abs(target - K @ w - smoothing * w - b[0] - s @ b[1:]).max()
            <= RESIDUAL * np.ptp(target, axis=0).max()
        ):
            raise ConfigurationError(
                *_closest(square, source), "landmarks far enough apart to distinguish their targets"
            )
        energy = 16.0 * math.pi * float((w * (K @ w)).sum()) / scale**2
        linear = b[1:] / scale
        affine = np.vstack((b[0] - centre @ linear - math.log(scale**2) * ((s**2).sum(axis=1) @ w), linear))
        values = (source, target, smoothing, w / scale**2, affine, max(0.0, energy), (centre, scale, s, w, b))
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            object.__setattr__(self, name, value)
        self.freeze()

    @property
    def known(self) -> Array:
        """The source landmarks (N, 2) [m]."""
        return self.source

    @property
    def parameters(self) -> int:
        """Number of landmarks."""
        return len(self.source)

    def values(self, points: Array) -> Array:
        """Images (M, 2) [m] of points (M, 2) [m]."""
        return self._summed(points, slopes=False)[0]

    def evaluate(self, points: Array) -> tuple[Array, Array]:
        """Images (M, 2) [m] and Jacobians (M, 2, 2) of points (M, 2) [m]."""
        return self._summed(points, slopes=True)

    def _summed(self, points: Array, *, slopes: bool) -> tuple[Array, Array]:
        from scipy.spatial.distance import cdist  # noqa: PLC0415  (slow to import)

        centre, scale, landmarks, w, b = self._frame
        with np.errstate(invalid="ignore", over="ignore"):
            s = (points - centre) / scale
            images, J = b[0] + s @ b[1:], b[1:].T + 0.0 * s[:, None, :]
            moments = np.column_stack((w, w * landmarks[:, :1], w * landmarks[:, 1:]))
            size = max(1, CHUNK // len(landmarks)) if w.any() else len(points) + 1
            for first in range(0, len(points) if w.any() else 0, size):
                rows = slice(first, first + size)
                square = cdist(s[rows], landmarks, "sqeuclidean")
                logarithm = np.log(square + TINY)
                images[rows] += np.multiply(square, logarithm, out=square) @ w
                if slopes:
                    sums = (2.0 * logarithm + 2.0) @ moments
                    J[rows, :, 0] += s[rows, :1] * sums[:, :2] - sums[:, 2:4]
                    J[rows, :, 1] += s[rows, 1:] * sums[:, :2] - sums[:, 4:]
        return images, J / scale

    def expression(self, point: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Image (2,) [m] and Jacobian (2, 2) of a symbol (2,) [m] of finite numbers."""
        centre, scale, landmarks, w, b = self._frame
        s = (point - ca.DM(centre)) / scale
        x, y = (s[i] - ca.DM(landmarks[:, i]) for i in (0, 1))
        square = x * x + y * y
        logarithm, weights, linear = ca.log(square + TINY), ca.DM(w.T), ca.DM(b[1:].T)
        slope = 2 * logarithm + 2
        bent = ca.horzcat(weights @ (slope * x), weights @ (slope * y))
        return ca.DM(b[0]) + linear @ s + weights @ (square * logarithm), (linear + bent) / scale


def _solved(K: Array, s: Array, target: Array, source: Array, scale: float) -> tuple[Array, Array]:
    """Weights (N, 2) and affine part (3, 2) of K w + R b = target, R' w = 0: Eqs. (28)-(30)."""
    from scipy.linalg import lu_factor, lu_solve  # noqa: PLC0415  (slow to import)

    R = np.column_stack((np.ones(len(s)), s))
    middle = target.mean(axis=0)
    b = np.linalg.lstsq(R, target - middle, rcond=None)[0]
    left = target - middle - R @ b
    terms = np.abs(target).max(axis=0) + np.abs(source).max(axis=0) @ np.abs(b[1:]) / scale
    left[:, np.abs(left).max(axis=0) <= AFFINE_ROUNDING * terms] = 0.0
    w = np.zeros_like(left)
    if left.any():
        L = np.block([[K, R], [R.T, np.zeros((3, 3))]])
        factor, right = lu_factor(L, check_finite=False), np.vstack((left, np.zeros((3, 2))))
        both = lu_solve(factor, right, check_finite=False)
        for _ in range(2):  # refined on the residual
            both += lu_solve(factor, right - L @ both, check_finite=False)
        w, b = np.where(left.any(axis=0), both[:-3], 0.0), b + both[-3:]
    b[0] += middle
    return w, b


def _landmarks(argument: str, value: ArrayLike) -> Array:
    """`value` as an array (N, 2) of at least three finite points."""
    points = np.array(checked_array(argument, value, "an array of points (N, 2)"))
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ConfigurationError(argument, value, "an array of at least 3 points (N, 2)")
    unusable = ~(np.abs(points) <= 1e100).all(axis=1)  # squares of larger ones would overflow
    if unusable.any():
        index = int(np.argmax(unusable))
        raise ConfigurationError(f"{argument}[{index}]", points[index].tolist(), "finite coordinates [m]")
    return points


def _unit_spread(source: Array) -> tuple[Array, float, Array, Array]:
    """Mean (2,), root mean square distance from it, landmarks in that frame, and their squared distances (N, N)."""
    from scipy.spatial.distance import cdist  # noqa: PLC0415  (slow to import)

    centre, rounding = source.mean(axis=0), 8 * float(np.finfo(np.float64).eps * np.abs(source).max())
    scale = float(np.sqrt(((source - centre) ** 2).sum(axis=1).mean()))
    if not scale > rounding:
        raise ConfigurationError("source", source[:2].tolist(), "different landmarks; these coincide")
    s = (source - centre) / scale
    along, across = np.linalg.svd(s, compute_uv=False) / math.sqrt(len(s))
    if not across > max(THINNEST * along, rounding / scale):
        raise ConfigurationError("source", source, "landmarks that do not all lie on one line")
    square = cdist(s, s, "sqeuclidean")
    if not (square + np.diag(np.full(len(s), np.inf))).min() > max(CLOSEST, rounding / scale) ** 2:
        raise ConfigurationError(*_closest(square, source), "different landmarks; these coincide")
    return centre, scale, s, square


def _closest(square: Array, source: Array) -> tuple[str, list[list[float]]]:
    """Names and coordinates of the two landmarks nearest to each other."""
    apart = square + np.diag(np.full(len(source), np.inf))
    first, second = sorted(divmod(int(np.argmin(apart)), len(source)))
    return f"source[{first}], source[{second}]", source[[first, second]].tolist()
