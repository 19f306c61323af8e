"""A fitted thin-plate spline at one point at a time, in a microsecond: what a tick uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic import BufferedFunction, PerThread
from rehab_opt.workspace.spline_cells import MANY, Cells, cell_function, cells_of
from rehab_opt.workspace.spline_fit import SplineFit
from rehab_opt.workspace.spline_kernel import point_function

__all__ = ["PointFunction", "cells_worth_having", "point_map"]

Array = NDArray[np.float64]
PointFunction = Callable[[Array], Any]
"""Array (2,) -> image (2,), or image and Jacobian (2, 2) where that was asked for; all its caller's own."""


def cells_worth_having(fit: SplineFit) -> Cells | None:
    """The cells of a map through many landmarks; None where summing over all of them is as quick."""
    return cells_of(fit) if len(fit.landmarks) >= MANY and np.any(fit.weights) else None


def point_map(fit: SplineFit, cells: Cells | None, *, with_jacobian: bool) -> PerThread[PointFunction]:
    """The compiled map of the thread that asks; maps of one size share the code, which is kept."""

    def made() -> PointFunction:
        direct = _direct(point_function(fit, with_jacobian=with_jacobian))
        if cells is None:
            return direct
        function = cell_function(cells.near, with_jacobian)
        return _by_cell(BufferedFunction(function, compile=None), fit, cells, direct)

    return PerThread(made)


# Closures and memory views: a method's attributes and numpy's assignments cost as much as the compiled code.
def _direct(function: BufferedFunction) -> PointFunction:
    held, copies = function.inputs[0].data, _copies(function)

    def at(point: Array) -> Any:
        held[0], held[1] = point.tolist()
        function.evaluate()
        return copies()

    return at


def _by_cell(function: BufferedFunction, fit: SplineFit, cells: Cells, direct: PointFunction) -> PointFunction:
    copies = _copies(function)
    point_of, frame, affine, row_of = function.inputs
    frame[:] = *fit.centre, 1 / fit.scale
    affine[...] = fit.affine.T
    held, held_row = point_of.data, row_of.data
    (left, bottom), per_length, columns, rows = cells[:4]
    table = [cells.table[place].data if place >= 0 else None for place in cells.place]
    last = -1

    def at(point: Array) -> Any:
        nonlocal last
        x, y = point.tolist()
        column, row = (x - left) * per_length, (y - bottom) * per_length
        if not (0 <= column < columns and 0 <= row < rows):  # NaN too
            return direct(point)
        cell = int(row) * columns + int(column)
        if cell != last:  # seldom so along a path
            series = table[cell]
            if series is None:
                return direct(point)
            held_row[:] = series
            last = cell
        held[0], held[1] = x, y
        function.evaluate()
        return copies()

    return at


def _copies(function: BufferedFunction) -> Callable[[], Any]:
    """What copies the outputs, alone or as a pair."""
    if len(function.outputs) == 1:
        return function.outputs[0].copy
    image, slopes = (output.copy for output in function.outputs)
    return lambda: (image(), slopes())
