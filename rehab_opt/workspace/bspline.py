"""A map of the plane as a uniform bicubic B-spline, whose derivatives can be bounded exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.plane_map import PlaneMap

__all__ = ["PlaneBSpline", "basis", "net_columns"]

Array = NDArray[np.float64]
CUBIC = np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]) / 6.0
"""Matrix from powers of t in [0, 1] to the four uniform cubic B-splines that are nonzero in a cell."""
ACROSS = 40
"""Number of start points of the inverse in each direction of the net."""


@dataclass(frozen=True, eq=False)
class PlaneBSpline(PlaneMap):
    """g(x) = sum_ij c_ij B(u - i) B(v - j), with (u, v) = (x - low) / step and cubic B-splines B.

    A point outside the net counts as the net's nearest point.

    Parameters
    ----------
    low : (2,) lower left corner of the net [m].
    step : (2,) size of a cell [m].
    coefficients : (m + 3, n + 3, 2) [m] for m x n cells.
    """

    low: Array
    step: Array
    coefficients: Array

    def __post_init__(self) -> None:
        for name in ("low", "step", "coefficients"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        self.freeze()

    @property
    def cells(self) -> tuple[int, int]:
        """Number of cells in x and y."""
        return self.coefficients.shape[0] - 3, self.coefficients.shape[1] - 3

    @property
    def parameters(self) -> int:
        """Number of coefficients, each a point."""
        return int(np.prod(self.coefficients.shape[:2]))

    @cached_property
    def known(self) -> Array:
        """A grid over the net, (n, 2) [m]."""
        sides = [self.low[i] + self.step[i] * self.cells[i] * (np.arange(ACROSS) + 0.5) / ACROSS for i in (0, 1)]
        return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)

    def evaluate(self, points: Array) -> tuple[Array, Array]:
        """Images (M, 2) [m] and Jacobians (M, 2, 2) of points (M, 2) [m]."""
        u, k = _cells_of(points, self.low, self.step, self.cells)
        window = np.arange(4)
        local = self.coefficients[k[:, 0, None, None] + window[:, None], k[:, 1, None, None] + window]
        (bx, dx), (by, dy) = ((basis(u[:, i], 0), basis(u[:, i], 1) / self.step[i]) for i in (0, 1))
        rows = [np.einsum("mi,mj,mijc->mc", a, b, local) for a, b in ((bx, by), (dx, by), (bx, dy))]
        return rows[0], np.stack(rows[1:], axis=2)

    def expression(self, point: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Expressions of the image (2,) [m] and the Jacobian (2, 2) at a symbol (2,) [m] with finite values."""
        u = ca.fmin(ca.fmax((point - ca.DM(self.low)) / ca.DM(self.step), 0), ca.DM(self.cells))
        cell = ca.fmin(ca.floor(u), ca.DM(self.cells) - 1)
        row = self.coefficients.shape[1]
        window = 2 * (np.arange(4)[:, None, None] * row + np.arange(4)[:, None]) + np.arange(2)
        first = 2 * (cell[0] * row + cell[1])
        local = ca.MX(ca.DM(self.coefficients.ravel()))[first + ca.DM(window.ravel())]
        value, slopes = _in_cell()(u - cell, local)
        return value, slopes @ ca.diag(1.0 / ca.DM(self.step))


def basis(t: Array, derivative: int) -> Array:
    """(m, 4) values of the four B-splines on a cell, or of a derivative up to the second, at t (m,) in [0, 1]."""
    powers = np.zeros((len(t), 4))
    for k in range(derivative, 4):
        powers[:, k] = math.perm(k, derivative) * t ** (k - derivative)
    return np.asarray(powers @ CUBIC.T)


@cache
def _in_cell() -> ca.Function:
    """Function (position in a cell (2,), its 4 x 4 coefficients (32,)) -> (image (2,), its derivatives (2, 2))."""
    place, local = ca.SX.sym("place", 2), ca.SX.sym("local", 32)
    powers = [ca.vertcat(1, t, t**2, t**3) for t in ca.vertsplit(place)]
    across, along = (ca.DM(CUBIC) @ each for each in powers)
    image = ca.reshape(local, 2, 16) @ ca.vec(along @ across.T)
    return ca.Function("in_cell", [place, local], [image, ca.jacobian(image, place)], {"cse": True})


def net_columns(points: Array, low: Array, step: Array, cells: tuple[int, int], order: tuple[int, int] = (0, 0)) -> Any:
    """Sparse matrix: coefficients of one coordinate -> values (M,) of the spline or a derivative at points (M, 2)."""
    from scipy.sparse import csr_array  # noqa: PLC0415  (slow to import)

    u, k = _cells_of(points, low, step, cells)
    bx, by = (basis(u[:, i], d) / step[i] ** d for i, d in enumerate(order))
    window = np.arange(4)
    columns = (k[:, 0, None, None] + window[:, None]) * (cells[1] + 3) + k[:, 1, None, None] + window
    values = bx[:, :, None] * by[:, None, :]
    rows = np.repeat(np.arange(len(points)), 16)
    shape = (len(points), (cells[0] + 3) * (cells[1] + 3))
    return csr_array((values.ravel(), (rows, columns.ravel())), shape=shape)


def _cells_of(points: Array, low: Array, step: Array, cells: tuple[int, int]) -> tuple[Array, NDArray[np.intp]]:
    """Two results: each point's position in its cell (M, 2), from 0 to 1, and index of the cell (NaN: the first)."""
    u = np.clip((points - low) / step, 0.0, cells)
    k = np.clip(np.floor(np.nan_to_num(u)), 0, np.array(cells) - 1).astype(np.intp)
    return u - k, k
