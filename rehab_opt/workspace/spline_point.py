"""A fitted thin-plate spline at one point at a time, in a microsecond: what a tick uses."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.compiled import compilation_wanted
from rehab_opt.workspace.spline_cells import MANY, Cells, cell_function, cells_of
from rehab_opt.workspace.spline_fit import Fit
from rehab_opt.workspace.spline_kernel import point_function

__all__ = ["PointMap", "cells_worth_having"]

Array = NDArray[np.float64]


def cells_worth_having(fit: Fit) -> Cells | None:
    """The cells of a map through many landmarks; None where summing over all of them is as quick."""
    return cells_of(fit) if len(fit.landmarks) >= MANY and np.any(fit.weights) else None


class PointMap(threading.local):
    """The compiled map of the thread that asks: a buffer belongs to one. Python makes it anew for each.

    `at` takes an array (2,) and gives the arrays of image (2,) and, where asked for, Jacobian (2, 2), which the next
    call overwrites.
    """

    def __init__(self, fit: Fit, cells: Cells | None, *, with_jacobian: bool) -> None:
        direct = _Direct(point_function(fit, with_jacobian=with_jacobian))
        self.at: Callable[[Array], tuple[Array, ...]] = direct
        if cells is not None:
            function = cell_function(cells.near, with_jacobian, compilation_wanted())
            self.at = _ByCell(BufferedFunction(function), fit, cells, direct)


class _Direct:
    __slots__ = ("evaluate", "function", "outputs", "point")

    def __init__(self, function: BufferedFunction) -> None:
        self.function, self.evaluate = function, function.evaluate  # which lives by the function
        self.point, self.outputs = function.inputs[0], function.outputs

    def __call__(self, point: Array) -> tuple[Array, ...]:
        self.point[...] = point
        self.evaluate()
        return self.outputs


class _ByCell:
    __slots__ = (
        "cell",
        "columns",
        "direct",
        "evaluate",
        "function",
        "outputs",
        "per_length",
        "place",
        "point",
        "row",
        "rows",
        "table",
        "x",
        "y",
    )

    def __init__(self, function: BufferedFunction, fit: Fit, cells: Cells, direct: _Direct) -> None:
        self.function, self.evaluate, self.outputs = function, function.evaluate, function.outputs
        self.point, frame, affine, self.row = function.inputs
        frame[:] = *fit.centre, 1 / fit.scale
        affine[...] = fit.affine.T
        (self.x, self.y), self.per_length, self.columns, self.rows = cells[:4]
        self.place, self.table = cells.place, cells.table
        self.cell, self.direct = -1, direct

    def __call__(self, point: Array) -> tuple[Array, ...]:
        x, y = point.tolist()
        column, row = (x - self.x) * self.per_length, (y - self.y) * self.per_length
        if not (0 <= column < self.columns and 0 <= row < self.rows):  # NaN too
            return self.direct(point)
        cell = int(row) * self.columns + int(column)
        if cell != self.cell:  # seldom so along a path
            place = self.place[cell]
            if place < 0:
                return self.direct(point)
            self.row[...] = self.table[place]
            self.cell = cell
        self.point[...] = point
        self.evaluate()
        return self.outputs
