"""Base of smooth maps of the plane: images, derivatives, exact inverse, and one expression for Python and C."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.symbolic import BufferedFunction, PerThread
from rehab_opt.workspace.point_arguments import point_array, single_point

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = ["PlaneMap"]

Array = NDArray[np.float64]
STARTS = 6
"""Number of starts that Newton's method tries: the known points with the nearest images."""
STEPS, HALVINGS = 30, 12
ROWS = 8
"""Number of points that are evaluated together."""
BEYOND = 1e100
"""[m] Coordinates whose squares overflow."""
CONVERGED = 1e-13
"""Relative error of the image below which only rounding remains."""


class PlaneMap(ABC):
    """A map (x, y) -> (x, y) [m] with continuous derivatives. Immutable and picklable; threads may share it.

    Numbers never raise an error, and NaN gives NaN.
    """

    def evaluate(self, points: Array) -> tuple[Array, Array]:
        """Images (M, 2) [m] and Jacobians (M, 2, 2) of points (M, 2) [m]."""
        found, some = np.empty((len(points), 6)), self._rows.mine
        for first in range(0, len(points), ROWS):
            rows = points[first : first + ROWS]
            some.inputs[0].T[: len(rows)] = rows
            some.evaluate()
            found[first : first + ROWS] = some.outputs[0].T[: len(rows)]
        return found[:, :2], found[:, 2:].reshape(-1, 2, 2).transpose(0, 2, 1)

    def values(self, points: Array) -> Array:
        """Images (M, 2) [m] of points (M, 2) [m]."""
        return self.evaluate(points)[0]

    @property
    @abstractmethod
    def known(self) -> Array:
        """Start points (n, 2) [m] of `inverse`, spread over the region of use."""

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Number of points in the plane that define the map."""

    @abstractmethod
    def expression(self, point: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Expressions of the image (2,) [m] and the Jacobian (2, 2) at a symbol (2,) [m] with finite values."""

    def __call__(self, points: ArrayLike) -> Array:
        """Images [m] of points (2,) or (M, 2) [m]."""
        array = point_array(points)
        if array.ndim == 2:
            return self.values(array)
        one = self._one.mine  # direct access: in a tick, `of` would take as long as the spline
        one.inputs[0][:] = array
        one.evaluate()
        return one.outputs[0].copy()

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives d image_i / d point_j, (2, 2) at a point (2,) or (M, 2, 2) at points (M, 2)."""
        array = point_array(points)
        return self.value_and_jacobian(array)[1] if array.ndim == 1 else self.evaluate(array)[1]

    def value_and_jacobian(self, point: ArrayLike) -> tuple[Array, Array]:
        """Image (2,) [m] and Jacobian (2, 2) at one point (2,)."""
        evaluated = self._both.mine
        evaluated.inputs[0][:] = single_point(point)
        evaluated.evaluate()
        image, slopes = evaluated.outputs
        return image.copy(), slopes.copy()

    def inverse(self, points: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Preimages of one point (2,) or several (M, 2); NaN where none is found.

        Damped Newton's method on the map, down to rounding, starts at `start`, then at the known points with the
        nearest images. If the map folds, a point may have several preimages: one of them is returned.

        Parameters
        ----------
        points : images [m].
        start : start values of the same shape, or (2,) for all [m].
        """
        array = point_array(points)
        images, tree = array.reshape(-1, 2), self._tree
        found = np.full(images.shape, np.nan)
        finite = (np.abs(images) < BEYOND).all(axis=1)
        if start is not None:
            first = point_array(start, "start")
            if first.shape not in {array.shape, (2,)}:
                raise ConfigurationError("start", f"an array of shape {first.shape}", f"(2,) or shape {array.shape}")
            found[finite] = self._newton(images[finite], np.broadcast_to(first, array.shape).reshape(-1, 2)[finite])
        for k in range(min(STARTS, len(self.known))):
            left = np.flatnonzero(finite & np.isnan(found[:, 0]))
            if not len(left):
                break
            near = np.minimum(tree.query(images[left], k=[k + 1])[1][:, 0], len(self.known) - 1)
            found[left] = self._newton(images[left], self.known[near])
        return found.reshape(array.shape)

    def _newton(self, images: Array, starts: Array) -> Array:
        """Preimages (M, 2), each by Newton's method from one start; NaN where it does not converge."""
        at = starts.copy()
        value, slopes = self.evaluate(at)
        off = images - value
        enough = CONVERGED * (1.0 + np.abs(images).max(axis=1) + np.abs(at).max(axis=1))
        for _ in range(STEPS):
            busy = np.flatnonzero(np.hypot(*off.T) > enough)
            if not len(busy):
                break
            step = _solved(slopes[busy], off[busy])
            for _ in range(HALVINGS):
                tried = at[busy] + step
                value, slope = self.evaluate(tried)
                error = images[busy] - value
                better = np.hypot(*error.T) < np.hypot(*off[busy].T)
                rows = busy[better]
                at[rows], slopes[rows], off[rows] = tried[better], slope[better], error[better]
                busy, step = busy[~better], 0.5 * step[~better]
                if not len(busy):
                    break
        at += np.nan_to_num(_solved(slopes, off))  # a last step, for the last digits
        at[~(np.hypot(*off.T) <= enough)] = np.nan
        return at

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

        return cKDTree(self.values(self.known))

    @cached_property
    def statement(self) -> ca.Function:
        """Function for Python and C: point (2,) [m] -> (image (2,) [m], Jacobian (2, 2)); NaN for NaN or infinity."""
        point = ca.MX.sym("point", 2)
        return ca.Function("plane_map", [point], self._masked(point), ["point"], ["image", "jacobian"])

    def _masked(self, point: ca.MX) -> list[ca.MX]:
        known = ca.logic_and(*ca.vertsplit(ca.fabs(point) < ca.inf))
        each = self.expression(ca.if_else(known, point, 0))
        return [ca.densify(ca.if_else(known, one, ca.DM.nan(2, k))) for one, k in zip(each, (1, 2), strict=True)]

    @cached_property
    def _one(self) -> PerThread[BufferedFunction]:
        point = ca.MX.sym("point", 2)
        image = ca.Function("plane_image", [point], self._masked(point)[:1])
        return PerThread(lambda: BufferedFunction(image))

    @cached_property
    def _rows(self) -> PerThread[BufferedFunction]:
        point = ca.MX.sym("point", 2)
        both = ca.vertcat(*(ca.vec(each) for each in self._masked(point)))
        rows = ca.Function("plane_row", [point], [both]).map(ROWS)
        return PerThread(lambda: BufferedFunction(rows))

    @cached_property
    def _both(self) -> PerThread[BufferedFunction]:
        return PerThread(lambda: BufferedFunction(self.statement))

    def freeze(self) -> None:
        """Make all arrays read-only."""
        for value in self.__dict__.values():
            for each in value if isinstance(value, tuple) else (value,):
                if isinstance(each, np.ndarray):
                    each.flags.writeable = False

    def __getstate__(self) -> dict[str, Any]:
        made = ("_tree", "statement", "_one", "_both", "_rows")
        return {name: value for name, value in self.__dict__.items() if name not in made}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.freeze()  # pickle does not keep the flag


def _solved(slopes: Array, right: Array) -> Array:
    """Solutions (M, 2) of M linear systems with 2 x 2 matrices; not finite for a singular matrix."""
    (a, b), (c, d) = (slopes[:, i].T for i in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        answer = np.column_stack([d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]])
        return np.asarray(answer / (a * d - b * c)[:, None])
