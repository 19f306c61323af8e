"""A smooth map of the plane through pairs of landmarks, which bends as little as they allow. Section V, Rossa et al."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.symbolic import PerThread
from rehab_opt.workspace.point_arguments import point_array, single_point
from rehab_opt.workspace.spline_fit import SplineFit, checked_landmarks, checked_smoothing, fitted
from rehab_opt.workspace.spline_inverse import Starts, preimage, preimages, tolerance_terms
from rehab_opt.workspace.spline_kernel import PointFunction, jacobians, point_function, values

__all__ = ["ThinPlateSpline"]

Array = NDArray[np.float64]
_FLOATS = np.dtype(np.float64)

NEIGHBOURS = 8
"""Landmarks around a wanted image whose sources are tried as starts of its inverse."""
INVERSE_CHUNK = 2**20
"""Distances to landmarks held at once while an inverse looks for starts."""


@dataclass(frozen=True, eq=False)
class ThinPlateSpline:
    """g(x, y) = b_0 + b_1 x + b_2 y + sum_i w_i U(|(x, y) - source_i|), U(r) = r^2 ln r^2: Eqs. (24)-(30), Rossa et al.

    Immutable, may be pickled and shared by threads: code and tables are made once, each thread gets its own buffers
    when it first maps a single point. Map one before a loop that must not wait: up to seconds where nothing is compiled
    yet. Afterwards a point costs microseconds; an array of points costs bounded memory. NaN in gives NaN out; nothing
    raises on numbers.

    Parameters
    ----------
    source : (N, 2) landmarks [m], N >= 3, different and not on one line. Three give an affine map.
    target : (N, 2) where they go [m]. Where these are affine in the sources up to rounding, in one coordinate or
        both, that coordinate's weights are exactly zero.
    smoothing : lambda >= 0. With sigma the root mean square distance of the sources from their mean,
        g minimises sum |g(source_i) - target_i|^2 + lambda sigma^2 / (16 pi) * bending energy; zero interpolates.
        Dimensionless: the same in metres and millimetres. It is on the diagonal of K where lengths are in units of
        sigma (scipy's `smoothing` is lambda sigma^2 / 2).

    Attributes
    ----------
    weights : (N, 2) w_i [1/m]; they sum to zero, and so do their products with the sources.
    affine : (3, 2) b_0 [m], b_1, b_2.
    bending_energy : Bookstein's, the integral (24) over the plane, summed over both coordinates: 16 pi sum_c w_c' K w_c
        with K of Eq. (27). No unit, never negative, zero for an affine map.

    Raises
    ------
    ConfigurationError : naming `source`, `target` or `smoothing`, and the landmark where one is to blame.
    """

    source: Array
    target: Array
    smoothing: float = 0.0
    weights: Array = field(init=False)
    affine: Array = field(init=False)
    bending_energy: float = field(init=False)
    _fit: SplineFit = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check, freeze and fit."""
        source, target = checked_landmarks("source", self.source), checked_landmarks("target", self.target)
        if len(source) != len(target):
            raise ConfigurationError("target", self.target, f"as many landmarks as the source has, {len(source)}")
        smoothing = checked_smoothing(self.smoothing)
        fit = fitted(source, target, smoothing)
        weights, affine = _in_given_units(fit)
        checked = {
            "source": source,
            "target": target,
            "smoothing": smoothing,
            "weights": weights,
            "affine": affine,
            "bending_energy": fit.bending_energy,
            "_fit": fit,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        self._freeze()

    # ------------------------------------------------------------------------------------------------ the map
    def __call__(self, points: ArrayLike) -> Array:
        """Images [m]: (2,) -> (2,), (M, 2) -> (M, 2)."""
        if type(points) is np.ndarray and points.shape == (2,) and points.dtype is _FLOATS:  # without a call to ask it
            return self._value.mine(points)  # type: ignore[no-any-return]
        array = point_array(points)
        return self._value.mine(array) if array.ndim == 1 else values(self._fit, array)

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives [[dg_x/dx, dg_x/dy], [dg_y/dx, dg_y/dy]]: (2,) -> (2, 2), (M, 2) -> (M, 2, 2)."""
        array = point_array(points)
        return self.value_and_jacobian(array)[1] if array.ndim == 1 else jacobians(self._fit, array)[1]

    def value_and_jacobian(self, point: ArrayLike) -> tuple[Array, Array]:
        """Image (2,) [m] and Jacobian (2, 2) of one point (2,) in one evaluation."""
        if not _is_point(point):
            point = np.array(single_point(point))
        return self._value_and_jacobian.mine(point)  # type: ignore[no-any-return]

    def inverse(self, points: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Points that the map sends to the given ones: (2,) -> (2,), (M, 2) -> (M, 2).

        Newton on the map itself, damped, until rounding stops it. Tried in turn as starts: `start`, the spline fitted
        the other way, the inverse of the affine part, the sources of the nearest landmarks. Where the map folds, a
        point may have several preimages or none: one of them is returned, the one Newton finds from `start` where
        that leads anywhere; NaN where none was found.

        Parameters
        ----------
        points : wanted images [m].
        start : an initial guess of the same shape, or (2,) for all [m]; the last answer, along a path.
        """
        array = point_array(points)
        if start is not None:
            start = _initial_guess(start, array.shape)
        if array.ndim == 1:
            return self._inverse_of_one(array, start)
        found = np.empty_like(array)
        size = max(1, INVERSE_CHUNK // len(self.source))
        for begin in range(0, len(array), size):
            rows = slice(begin, begin + size)
            found[rows] = self._inverse_of_some(array[rows], None if start is None else start[rows])
        return found

    # ------------------------------------------------------------------------------------------------ the inverse
    def _inverse_of_some(self, images: Array, start: Array | None) -> Array:
        found = np.full(images.shape, np.nan)
        rows = np.flatnonzero(np.isfinite(images).all(axis=1))
        if start is not None:
            found[rows] = preimages(self._evaluated, self._fit, images[rows], [lambda _: start[rows]])
            rows = rows[np.isnan(found[rows, 0])]
        found[rows] = preimages(self._evaluated, self._fit, images[rows], self._starts)
        return found

    def _inverse_of_one(self, image: Array, start: Array | None) -> Array:
        x, y = image.tolist()
        if not (math.isfinite(x) and math.isfinite(y)):
            return np.full(2, np.nan)
        at, point = self._value_and_jacobian.mine, np.empty(2)

        def values_at(x: float, y: float) -> tuple[float, ...]:
            point[0], point[1] = x, y
            value, slopes = at(point)
            return *value.tolist(), *slopes.ravel().tolist()

        def starts() -> Iterator[tuple[float, float]]:
            if start is not None:
                yield tuple(start.tolist())
            if self._other_way is not None:
                yield tuple(self._other_way(image).tolist())  # as one point, which is quicker
            for more in self._starts[self._other_way is not None :]:
                yield tuple(more(image[np.newaxis])[0].tolist())

        constant, growth = self._tolerance
        return np.array(preimage(values_at, x, y, starts(), constant + growth * math.hypot(x, y)))

    @cached_property
    def _tolerance(self) -> tuple[float, float]:
        return tolerance_terms(self._fit)

    @cached_property
    def _other_way(self) -> ThinPlateSpline | None:
        try:
            return ThinPlateSpline(self.target, self.source)
        except ConfigurationError:  # where targets coincide; elsewhere there may be an inverse
            return None

    @cached_property
    def _starts(self) -> list[Starts]:
        starts: list[Starts] = [] if self._other_way is None else [self._other_way]
        linear = self._fit.affine[1:]
        if abs(np.linalg.det(linear)) > 1e-12 * float(np.sum(linear**2)):
            back = np.linalg.inv(linear) * self._fit.scale
            starts.append(lambda images: self._fit.centre + (images - self._fit.affine[0]) @ back)
        starts += [self._nearest_source(k) for k in range(min(NEIGHBOURS, len(self.source)))]
        return starts

    def _nearest_source(self, k: int) -> Starts:
        """Source of the landmark whose target is the k-th nearest."""

        def start(images: Array) -> Array:
            with np.errstate(over="ignore"):
                square = (images[:, :1] - self.target[:, 0]) ** 2 + (images[:, 1:] - self.target[:, 1]) ** 2
            return self.source[np.argpartition(square, k, axis=1)[:, k]]

        return start

    # ------------------------------------------------------------------------------------------------ plumbing
    def _evaluated(self, points: Array) -> tuple[Array, Array]:
        return jacobians(self._fit, points)

    @cached_property
    def _value(self) -> PerThread[PointFunction]:
        return PerThread(lambda: point_function(self._fit, with_jacobian=False))

    @cached_property
    def _value_and_jacobian(self) -> PerThread[PointFunction]:
        return PerThread(lambda: point_function(self._fit, with_jacobian=True))

    def _freeze(self) -> None:
        for array in (self.source, self.target, self.weights, self.affine, *self._fit):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False

    def __getstate__(self) -> dict[str, Any]:
        return {one.name: self.__dict__[one.name] for one in fields(self)}  # what is made when needed is made anew

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._freeze()  # pickle forgets it


def _in_given_units(fit: SplineFit) -> tuple[Array, Array]:
    """Weights (N, 2) and affine part (3, 2) for distances in metres, not in units of the spread.

    ln r^2 shifts by ln sigma^2; under the side conditions sum w |s - s_i|^2 is the constant sum w |s_i|^2.
    """
    linear = fit.affine[1:] / fit.scale
    shift = math.log(fit.scale**2) * (np.sum(fit.landmarks**2, axis=1) @ fit.weights)
    return fit.weights / fit.scale**2, np.vstack((fit.affine[0] - fit.centre @ linear - shift, linear))


def _is_point(points: ArrayLike) -> TypeGuard[Array]:
    """Whether it is an array (2,) that compiled code may take as it is: the usual case, in a tick."""
    return type(points) is np.ndarray and points.shape == (2,) and points.dtype is _FLOATS


def _initial_guess(start: ArrayLike, shape: tuple[int, ...]) -> Array:
    guess = point_array(start, "start")
    if guess.shape not in {shape, (2,)}:
        raise ConfigurationError("start", f"an array of shape {guess.shape}", f"a point (2,), or of shape {shape}")
    return np.broadcast_to(guess, shape)
