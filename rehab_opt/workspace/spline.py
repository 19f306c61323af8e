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

__all__ = ["ThinPlateSpline"]

Array = NDArray[np.float64]
TINY = 1e-300
"""Added to r^2 in the logarithm so that U(0) = 0; negligible otherwise."""
EPSILON = float(np.finfo(np.float64).eps)
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

    Attributes
    ----------
    weights : (N, 2) w_i [1/m]; they sum to zero, and so do their products with the sources.
    affine : (3, 2) b_0 [m], b_1, b_2.

    Raises
    ------
    ConfigurationError : an invalid `source` or `target`; the error names the argument and, if possible, the landmark.
    """

    source: Array
    target: Array
    weights: Array = field(init=False)
    affine: Array = field(init=False)
    _frame: tuple[Array, float, Array, Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Compute the weights, with landmarks centred and scaled for good conditioning: Eq. (29)."""
        source, target = _landmarks("source", self.source), _landmarks("target", self.target)
        if len(source) != len(target):
            raise ConfigurationError("target", self.target, f"as many landmarks as the source has, {len(source)}")
        centre, scale, s, square = _unit_spread(source)
        K, R = square * np.log(square + TINY), np.column_stack((np.ones(len(s)), s))
        w, b = _solved(K, R, target, np.abs(source).max() / scale)
        if not np.abs(target - K @ w - R @ b).max() <= RESIDUAL * np.ptp(target, axis=0).max():
            raise ConfigurationError(*_closest(square, source), "landmarks far enough apart for different targets")
        linear = b[1:] / scale
        affine = np.vstack((b[0] - centre @ linear - math.log(scale**2) * ((s**2).sum(axis=1) @ w), linear))
        values = (source, target, w / scale**2, affine, (centre, scale, s, w, b))
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
        """Images (M, 2) [m] of points (M, 2) [m], in a fraction of the time of `evaluate`."""
        from scipy.spatial.distance import cdist  # noqa: PLC0415  (slow to import)

        centre, scale, landmarks, w, b = self._frame
        with np.errstate(invalid="ignore", over="ignore"):
            s = (points - centre) / scale
            images = np.asarray(b[0] + s @ b[1:])
            size = max(1, CHUNK // len(landmarks))
            for rows in (slice(first, first + size) for first in range(0, len(s) if w.any() else 0, size)):
                square = cdist(s[rows], landmarks, "sqeuclidean")
                images[rows] += np.multiply(square, np.log(square + TINY), out=square) @ w
        return images

    def expression(self, point: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Expressions of the image (2,) [m] and the Jacobian (2, 2) at a symbol (2,) [m] with finite values."""
        centre, scale, landmarks, w, b = self._frame
        s = (point - ca.DM(centre)) / scale
        x, y = (s[i] - ca.DM(landmarks[:, i]) for i in (0, 1))
        square = x * x + y * y
        logarithm, weights, linear = ca.log(square + TINY), ca.DM(w.T), ca.DM(b[1:].T)
        slope = 2 * logarithm + 2
        bent = ca.horzcat(weights @ (slope * x), weights @ (slope * y))
        return ca.DM(b[0]) + linear @ s + weights @ (square * logarithm), (linear + bent) / scale


def _solved(K: Array, R: Array, target: Array, size: float) -> tuple[Array, Array]:
    """Weights w (N, 2) and affine part b (3, 2) that solve K w + R b = target, R^T w = 0: Eqs. (28)-(30).

    If the targets are an affine function of the sources up to rounding, the weights are zero. `size` is the size of the
    sources' coordinates over their spread; it determines the rounding error.
    """
    middle = target.mean(axis=0)
    b = np.linalg.lstsq(R, target - middle, rcond=None)[0]
    left = target - middle - R @ b
    rounding = 32 * EPSILON * (np.abs(target).max(axis=0) + size * np.abs(b[1:]).sum(axis=0))
    left[:, np.abs(left).max(axis=0) <= rounding] = 0.0
    L = np.block([[K, R], [R.T, np.zeros((3, 3))]])
    right = np.vstack((left, np.zeros((3, 2))))
    both = np.linalg.solve(L, right)
    both += np.linalg.solve(L, right - L @ both)  # refined on the residual
    return np.where(left.any(axis=0), both[:-3], 0.0), b + both[-3:] + np.vstack((middle, np.zeros((2, 2))))


def _landmarks(argument: str, value: ArrayLike) -> Array:
    points = np.array(checked_array(argument, value, "an array of points (N, 2)"))
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ConfigurationError(argument, value, "an array of at least 3 points (N, 2)")
    unusable = ~(np.abs(points) <= 1e100).all(axis=1)  # squares of larger ones would overflow
    if unusable.any():
        index = int(np.argmax(unusable))
        raise ConfigurationError(f"{argument}[{index}]", points[index].tolist(), "finite coordinates [m]")
    return points


def _unit_spread(source: Array) -> tuple[Array, float, Array, Array]:
    """Four results: mean (2,), rms distance from the mean, scaled landmarks, their squared distances (N, N)."""
    from scipy.spatial.distance import cdist  # noqa: PLC0415  (slow to import)

    centre, rounding = source.mean(axis=0), 8 * EPSILON * float(np.abs(source).max())
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
    """Names and coordinates, as text, of the two landmarks nearest to each other."""
    apart = square + np.diag(np.full(len(source), np.inf))
    first, second = sorted(divmod(int(np.argmin(apart)), len(source)))
    return f"source[{first}], source[{second}]", source[[first, second]].tolist()
