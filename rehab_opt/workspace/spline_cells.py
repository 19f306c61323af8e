"""The sum over many landmarks as short series, one for each cell of a grid: the cost of a point stops growing with N.

With z = x + iy and d = c - z_i for a cell's centre c, each term of Eq. (25) is, for zeta = z - c,

    U(|zeta + d|) = 2 Re((conj(zeta) + conj(d)) M(zeta)),    M(zeta) = (zeta + d) ln(zeta + d) = sum_k m_k zeta^k,
    m_0 = d ln|d|,  m_1 = 1 + ln|d|,  m_k = (-1)^k d^(1-k) / (k (k - 1))

(an imaginary constant in the logarithm drops out of the real part). Landmarks at least `FAR` cell radii away are summed
into two series a coordinate, E(zeta) + conj(zeta) H(zeta); they are cut where what is left, below
FAR^-`TERMS` / `TERMS`^2 of a term, is beneath its rounding. The few nearer ones are evaluated as they are.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.spline_fit import TINY, SplineFit

__all__ = ["MANY", "Cells", "cell_function", "cells_of"]

Array = NDArray[np.float64]

MANY = 64
"""Landmarks from which on cells are worth their table."""
FAR, TERMS = 4.0, 23
CELLS_A_LANDMARK, MAX_CELLS = 5.0, 2048
MARGIN = 0.1
"""Share of the landmarks' box by which the grid reaches beyond it on each side."""
CHUNK = 2**16


class Cells(NamedTuple):
    """A grid over the landmarks' box and what stands for the landmarks in each of its cells."""

    corner: tuple[float, float]
    """Least x and y of the grid, in the source's unit."""
    per_length: float
    """Cells to a unit of length."""
    columns: int
    rows: int
    near: int
    """Landmarks that a cell has room for."""
    place: list[int]
    """Row of `table` by cell, x running first; -1 where too many landmarks are near."""
    table: Array
    """Centre (2), 1 / radius, E and H (2 * 2 * TERMS complex numbers), near landmarks and their weights (4 * near)."""


def cells_of(fit: SplineFit) -> Cells:
    """The cells of a fitted spline, in its coordinates of unit spread but for the corner."""
    low, size = fit.landmarks.min(axis=0), np.ptp(fit.landmarks, axis=0)
    low, size = low - MARGIN * size, (1 + 2 * MARGIN) * size
    count = min(MAX_CELLS, CELLS_A_LANDMARK * len(fit.landmarks))
    side = math.sqrt(float(size[0] * size[1]) / count)
    side = max(side, float(size.max()) / count)  # of a thin box
    columns, rows = (int(n) for n in np.ceil(size / side))
    radius = side / math.sqrt(2)
    x, y = (np.arange(columns * rows) % columns), (np.arange(columns * rows) // columns)
    centres = low + side * (np.column_stack((x, y)) + 0.5)
    near = 16 if len(fit.landmarks) <= MAX_CELLS / CELLS_A_LANDMARK else 48

    table, place = [], []
    step = max(1, CHUNK // len(fit.landmarks))
    for begin in range(0, len(centres), step):
        some = centres[begin : begin + step]
        offset = some[:, np.newaxis] - fit.landmarks
        close = np.hypot(offset[..., 0], offset[..., 1]) < FAR * radius
        kept = close.sum(axis=1) <= near
        table.append(_rows(fit, some[kept], close[kept], radius, near))
        place.append(kept)
    kept = np.concatenate(place)
    corner = fit.centre + fit.scale * low
    return Cells(
        corner=(float(corner[0]), float(corner[1])),
        per_length=1 / (side * fit.scale),
        columns=columns,
        rows=rows,
        near=near,
        place=np.where(kept, np.cumsum(kept) - 1, -1).tolist(),
        table=np.vstack(table),
    )


def _rows(fit: SplineFit, centres: Array, close: NDArray[np.bool_], radius: float, near: int) -> Array:
    cells = len(centres)
    offset = centres[:, np.newaxis] - fit.landmarks
    d = np.where(close, 1.0, offset[..., 0] + 1j * offset[..., 1])  # near ones are masked below, and must not be zero
    log = np.log(np.abs(d))
    inverse = radius / d  # zeta is counted in radii, which keeps the powers in range
    far = ~close
    series = np.empty((cells, 2, 2, TERMS), dtype=complex)  # cell, coordinate, E or H, term
    power, conjugate, twice = d * far, np.conj(d), 2 * np.ascontiguousarray(fit.weights.T)
    for k in range(TERMS):
        if k == 0:
            m = power * log
        elif k == 1:
            m = radius * (1 + log) * far
        else:
            power = power * inverse if k > 2 else radius * inverse * far
            m = power * ((-1) ** k / (k * (k - 1)))
        weighted = conjugate * m
        for i in range(2):  # one-column sums, in which a threaded matrix product would only wait for its threads
            series[:, i, 0, k] = np.einsum("cn,n->c", weighted, twice[i])
            series[:, i, 1, k] = np.einsum("cn,n->c", m, twice[i]) * radius  # of conj(zeta) in radii
    rows = np.zeros((cells, 3 + 8 * TERMS + 4 * near))
    rows[:, :2], rows[:, 2] = centres, 1 / radius
    rows[:, 3 : 3 + 8 * TERMS] = series.reshape(cells, -1).view(np.float64)
    which, landmark = np.nonzero(close)
    slot = np.arange(len(which)) - np.searchsorted(which, which)  # counted anew in every cell
    at = 3 + 8 * TERMS + 4 * slot
    for i in range(2):
        rows[which, at + i] = fit.landmarks[landmark, i]
        rows[which, at + 2 + i] = fit.weights[landmark, i]
    return rows


@functools.lru_cache(maxsize=8)
def cell_function(near: int, with_jacobian: bool) -> ca.Function:
    """Point (2,), frame (3,), affine part (2, 3), row of a table -> image (2,) and, if asked for, Jacobian (2, 2)."""
    point, frame, affine = ca.SX.sym("point", 2), ca.SX.sym("frame", 3), ca.SX.sym("affine", 2, 3)
    row = ca.SX.sym("row", 3 + 8 * TERMS + 4 * near)
    s = (point - frame[:2]) * frame[2]
    x, y = (s[0] - row[0]) * row[2], (s[1] - row[1]) * row[2]
    image, by_x, by_y = affine[:, 0] + affine[:, 1:] @ s, affine[:, 1], affine[:, 2]
    for i in range(2):
        begin = 3 + 4 * TERMS * i
        (e, e_slope), (h, h_slope) = (
            _horner(row[begin + 2 * TERMS * j : begin + 2 * TERMS * (j + 1)], x, y) for j in range(2)
        )
        image[i] += e[0] + x * h[0] + y * h[1]
        # dG/dzeta = E' + conj(zeta) H', dG/dconj(zeta) = H
        slope = (e_slope[0] + x * h_slope[0] + y * h_slope[1], e_slope[1] + x * h_slope[1] - y * h_slope[0])
        by_x[i] += (slope[0] + h[0]) * row[2]
        by_y[i] += (h[1] - slope[1]) * row[2]
    for i in range(near):
        begin = 3 + 8 * TERMS + 4 * i
        d, w = s - row[begin : begin + 2], row[begin + 2 : begin + 4]
        square = d[0] * d[0] + d[1] * d[1]
        logarithm = ca.log(square + TINY)
        image += w * (square * logarithm)
        by_x += w * ((2 * logarithm + 2) * d[0])
        by_y += w * ((2 * logarithm + 2) * d[1])
    results = [image, ca.horzcat(by_x, by_y) * frame[2]] if with_jacobian else [image]
    name = f"thin_plate_cell_{'jacobian' if with_jacobian else 'value'}_{near}"
    return ca.Function(name, [point, frame, affine, row], results)


def _horner(coefficients: ca.SX, x: ca.SX, y: ca.SX) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    """A complex polynomial at x + iy and its derivative, as real and imaginary parts; coefficients interleaved."""
    terms = coefficients.numel() // 2
    u, v = coefficients[2 * terms - 2], coefficients[2 * terms - 1]
    du, dv = ca.SX(0), ca.SX(0)
    for k in reversed(range(terms - 1)):
        du, dv = du * x - dv * y + u, du * y + dv * x + v
        u, v = u * x - v * y + coefficients[2 * k], u * y + v * x + coefficients[2 * k + 1]
    return (u, v), (du, dv)
