"""The linear solve behind a thin-plate spline: landmarks in, weights and affine part out. Section V, Rossa et al."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["TINY", "SplineFit", "checked_landmarks", "checked_smoothing", "fitted"]

Array = NDArray[np.float64]

TINY = 1e-300
"""Added to r^2 under the logarithm, so that U(0) = 0 without a branch; any r^2 that is not zero absorbs it."""
EPSILON = float(np.finfo(np.float64).eps)
AFFINE_ROUNDING = 32 * EPSILON
"""Share of the landmarks' coordinates up to which a departure from an affine map is taken for their rounding.

A caller who computes A x + b rounds it to within 3 units in the last place of the largest term, x itself carries one,
and centring and projecting add a few more; below this, bending cannot be told from rounding.
"""
CLOSEST = 1e-7
"""Landmarks closer than this share of their spread are the same one: their rows of K, which differ by about
d^2 ln d^2, then agree to the rounding of K."""
THINNEST = 1e-8
"""Landmarks whose spread across is less than this share of their spread along lie on a line."""
RESIDUAL = 1e-8
"""Largest share of the target's spread by which a fit may miss its equations."""


class SplineFit(NamedTuple):
    """A spline in the coordinates s = (x - centre) / scale, in which its landmarks have unit spread.

    g = affine[0] + s_x affine[1] + s_y affine[2] + sum_i weights[i] U(|s - landmarks[i]|), in the target's unit.
    """

    centre: Array
    """(2,) mean of the source landmarks [m]."""
    scale: float
    """Root mean square distance of the source landmarks from it [m]."""
    landmarks: Array
    """(N, 2) source landmarks in these coordinates."""
    weights: Array
    """(N, 2) w [m]; exactly zero in a coordinate whose data are affine."""
    affine: Array
    """(3, 2) b_0, b_1, b_2 [m]."""
    bending_energy: float
    """Of both coordinates, [m^2 of the target per m^2 of the source]."""


def fitted(source: Array, target: Array, smoothing: float) -> SplineFit:
    """The spline through the landmarks: Eqs. (24)-(30), with U on unit spread for the sake of the solve's conditioning.

    The side conditions sum w = 0, sum w x' = 0 are eliminated by a QR of R (Eq. 28): w = Q_2 c, where Q_2' K Q_2 is
    positive definite, since U = r^2 ln r^2 is conditionally so, and better conditioned than the L of Eq. (29). Refined
    twice on the residual of the full equations.

    Parameters
    ----------
    source, target : (N, 2) checked landmarks [m].
    smoothing : lambda >= 0 on the diagonal of K in unit spread.

    Raises
    ------
    ConfigurationError : source landmarks that coincide, lie on a line, or are too close together to solve for.
    """
    centre, scale, landmarks = _unit_spread(source)
    square = _square_distances(landmarks)
    _check_apart(square, source, scale)
    R = np.column_stack((np.ones(len(source)), landmarks))

    middle = target.mean(axis=0)
    values = target - middle
    affine = np.linalg.lstsq(R, values, rcond=None)[0]
    departure = values - R @ affine
    terms = np.abs(target).max(axis=0) + np.abs(source).max(axis=0) @ np.abs(affine[1:]) / scale
    departure[:, np.abs(departure).max(axis=0) <= AFFINE_ROUNDING * terms] = 0.0
    weights, energy = np.zeros_like(values), 0.0
    if np.any(departure):
        K = _kernel_matrix(square)
        K[np.diag_indices_from(K)] = smoothing
        solve = _solver(K, R)
        left, more = departure, np.zeros_like(affine)
        for _ in range(3):
            correction = solve(left)
            weights, more = weights + correction[0], more + correction[1]
            left = departure - K @ weights - R @ more
        if not float(np.abs(left).max()) <= RESIDUAL * float(np.abs(values).max()):
            argument, pair = _closest(square, source)
            raise ConfigurationError(argument, pair, "landmarks far enough apart to tell their targets apart")
        affine += more
        # w' K w without the smoothing's share of the diagonal; w is orthogonal to the affine part.
        energy = float(np.sum(weights * (departure - smoothing * weights)))
    affine[0] += middle
    return SplineFit(centre, scale, landmarks, weights, affine, max(0.0, 16 * math.pi * energy / scale**2))


def _solver(K: Array, R: Array) -> Callable[[Array], tuple[Array, Array]]:
    """Values (N, 2) -> w, b with K w + R b = values and R' w = 0, all else factored."""
    from scipy.linalg import lapack, lu_factor, lu_solve  # noqa: PLC0415  (heavy)

    reflectors, tau, _, _ = lapack.dgeqrf(R)
    triangle = np.triu(reflectors[:3])

    def turned(side: str, transposed: str, matrix: Array) -> Array:
        return np.asarray(lapack.dormqr(side, transposed, reflectors, tau, np.asfortranarray(matrix), 64 * len(R))[0])

    reduced = turned("R", "N", turned("L", "T", K))  # Q' K Q by its three reflectors, without forming Q
    # Definite on paper, yet LU: where landmarks are very close together rounding takes the definiteness away, and on
    # busy cores the threaded Cholesky of OpenBLAS can take ten times longer.
    factor = lu_factor(reduced[3:, 3:], check_finite=False)
    coupling = reduced[:3, 3:]

    def solve(values: Array) -> tuple[Array, Array]:
        z = turned("L", "T", values)
        c = lu_solve(factor, z[3:], check_finite=False)
        w = turned("L", "N", np.vstack((np.zeros((3, values.shape[1])), c)))
        return w, np.linalg.solve(triangle, z[:3] - coupling @ c)

    return solve


def checked_landmarks(argument: str, value: ArrayLike) -> Array:
    """`value` as a read-only array (N, 2) of at least three finite points."""
    points = np.array(checked_array(argument, value, "an array of points (N, 2)"))
    if points.ndim != 2 or points.shape[1] != 2:
        raise ConfigurationError(argument, value, "an array of points (N, 2)")
    if len(points) < 3:
        raise ConfigurationError(argument, value, "at least 3 points")
    unusable = ~(np.abs(points) <= 1e100).all(axis=1)  # squares of larger ones would overflow
    if np.any(unusable):
        index = int(np.argmax(unusable))
        raise ConfigurationError(f"{argument}[{index}]", points[index].tolist(), "finite coordinates [m]")
    points.flags.writeable = False
    return points


def checked_smoothing(value: float) -> float:
    """`value` as a finite number, zero or positive."""
    try:
        smoothing = float(value)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError("smoothing", value, "a number, zero or positive") from problem
    if not 0 <= smoothing < math.inf:
        raise ConfigurationError("smoothing", value, "a finite number, zero or positive")
    return smoothing


def _unit_spread(source: Array) -> tuple[Array, float, Array]:
    centre = source.mean(axis=0)
    centred = source - centre
    spread = math.sqrt(float(np.mean(np.sum(centred**2, axis=1))))
    rounding = 8 * EPSILON * float(np.abs(source).max())
    if not spread > rounding:
        raise ConfigurationError("source", source[:2].tolist(), "different landmarks; these coincide")
    along, across = np.linalg.svd(centred / spread, compute_uv=False) / math.sqrt(len(source))
    if not across > max(THINNEST * along, rounding / spread):
        raise ConfigurationError("source", source, "landmarks that do not all lie on one line")
    return centre, spread, centred / spread


def _square_distances(points: Array) -> Array:
    square = (points[:, :1] - points[:, 0]) ** 2
    square += (points[:, 1:] - points[:, 1]) ** 2
    return square


def _kernel_matrix(square: Array) -> Array:
    """U of all distances, Eq. (27); its diagonal is left to the caller."""
    kernel = np.log(square)
    kernel *= square
    return np.asfortranarray(kernel)  # as LAPACK wants it


def _check_apart(square: Array, source: Array, scale: float) -> None:
    """Refuse landmarks that coincide; fills the diagonal of `square`."""
    np.fill_diagonal(square, np.inf)
    least = max(CLOSEST, 8 * EPSILON * float(np.abs(source).max()) / scale)
    if not float(square.min()) > least**2:
        raise ConfigurationError(*_closest(square, source), "different landmarks; these coincide")


def _closest(square: Array, source: Array) -> tuple[str, list[list[float]]]:
    """The names and coordinates of the two landmarks nearest to each other."""
    first, second = sorted(divmod(int(np.argmin(square)), len(source)))
    return f"source[{first}], source[{second}]", source[[first, second]].tolist()
