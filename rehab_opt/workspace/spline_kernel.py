"""A fitted thin-plate spline as fast numbers: compiled code for one point, chunks of arrays for many. Eq. (25).

One logarithm a landmark in both.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.compiled import table_size, table_step
from rehab_opt.workspace.spline_fit import TINY, SplineFit

__all__ = ["PointFunction", "jacobians", "point_function", "point_inputs", "point_statement", "values"]

Array = NDArray[np.float64]
PointFunction = Callable[[Array], Any]
"""Array (2,) -> image (2,), or image and Jacobian (2, 2) where that was asked for; all its caller's own."""

CHUNK = 32768
"""Numbers in a temporary array: a few of them stay in a processor's second-level cache, and memory is bounded."""
BLOCK = 16
"""Landmarks written out in the body of the compiled loop."""


# ------------------------------------------------------------------------------------------------------ one point
def point_function(fit: SplineFit, *, with_jacobian: bool) -> PointFunction:
    """The map of one thread, with buffers of its own.

    Code is compiled for a few landmark counts only, at most an eighth apart (weights of zero fill up the rest), so that
    maps share it.
    """
    count, block = _rounded(_bending_landmarks(fit))
    evaluated = BufferedFunction(_stated(count, block, with_jacobian), compile=None)
    for held, values in zip(evaluated.inputs[1:], point_inputs(fit), strict=True):
        held[...] = values
    # A memory view and a closure: numpy's assignments and a method's attributes cost as much as the compiled code.
    point_held = evaluated.inputs[0].data
    copies = tuple(output.copy for output in evaluated.outputs)

    def at(point: Array) -> Any:
        point_held[0], point_held[1] = point.tolist()
        evaluated.evaluate()
        return (copies[0](), copies[1]()) if with_jacobian else copies[0]()

    return at


def point_statement(fit: SplineFit, *, with_jacobian: bool) -> ca.Function:
    """The same function, not compiled; its inputs behind the point are `point_inputs`."""
    return _stated(*_rounded(_bending_landmarks(fit)), with_jacobian)


def point_inputs(fit: SplineFit) -> tuple[Array, Array, Array, Array]:
    """Frame (3,), affine part (2, 3), landmarks and weights (2, count)."""
    n = _bending_landmarks(fit)
    landmarks, weights = np.zeros((2, 2, _rounded(n)[0]))
    landmarks[:, :n], weights[:, :n] = fit.landmarks[:n].T, fit.weights[:n].T
    return np.array((*fit.centre, 1 / fit.scale)), fit.affine.T, landmarks, weights


def _bending_landmarks(fit: SplineFit) -> int:
    """How many there are; none where the map is affine."""
    return len(fit.landmarks) if np.any(fit.weights) else 0


def _rounded(count: int) -> tuple[int, int]:
    """Landmarks to compile for, and how many of them to a block."""
    count = max(count, 1)  # one of weight zero lets NaN through an affine map
    return table_size(count), min(table_step(count), BLOCK)


@functools.lru_cache(maxsize=64)
def _stated(count: int, block: int, with_jacobian: bool) -> ca.Function:
    point, frame, affine = ca.MX.sym("point", 2), ca.MX.sym("frame", 3), ca.MX.sym("affine", 2, 3)
    landmarks, weights = ca.MX.sym("landmarks", 2, count), ca.MX.sym("weights", 2, count)
    s = (point - frame[:2]) * frame[2]
    linear = affine[:, 1:]
    total = affine[:, 0] + linear @ s
    if with_jacobian:
        total = ca.vertcat(total, ca.vec(linear))
    # The loop sums as it goes and takes the same point every time.
    bending = _bending(block, with_jacobian).map("bending", "serial", count // block, [0], [0])
    total += bending(s, landmarks, weights)
    results = [total[:2]]
    if with_jacobian:
        results.append(ca.reshape(total[2:], 2, 2) * frame[2])
    name = f"thin_plate_{'jacobian' if with_jacobian else 'value'}_{count}"
    inputs = [point, frame, affine, landmarks, weights]
    return ca.Function(name, inputs, [ca.densify(result) for result in results])


def _bending(block: int, with_jacobian: bool) -> ca.Function:
    """s, some landmarks, their weights -> their share of the sum in Eq. (25), and of its derivatives by s_x and s_y."""
    s, landmarks, weights = ca.SX.sym("s", 2), ca.SX.sym("landmarks", 2, block), ca.SX.sym("weights", 2, block)
    value, by_x, by_y = ca.SX.zeros(2), ca.SX.zeros(2), ca.SX.zeros(2)
    for i in range(block):
        d, w = s - landmarks[:, i], weights[:, i]
        square = d[0] * d[0] + d[1] * d[1]
        logarithm = ca.log(square + TINY)
        value += w * (square * logarithm)
        slope = 2 * logarithm + 2
        by_x += w * (slope * d[0])
        by_y += w * (slope * d[1])
    total = ca.vertcat(value, by_x, by_y) if with_jacobian else value
    return ca.Function("landmarks", [s, landmarks, weights], [total])


# ---------------------------------------------------------------------------------------------------- many points
def values(fit: SplineFit, points: Array) -> Array:
    """(M, 2) images of points (M, 2)."""
    with np.errstate(invalid="ignore", over="ignore"):  # what is infinite ends as NaN, without a word in a loop
        s = (points - fit.centre) / fit.scale
        images = fit.affine[0] + s @ fit.affine[1:]
        if np.any(fit.weights):
            for rows, (_, _, square, logarithm) in _distances(fit, s):
                images[rows] += np.multiply(square, logarithm, out=square) @ fit.weights
    return images  # type: ignore[no-any-return]


def jacobians(fit: SplineFit, points: Array) -> tuple[Array, Array]:
    """(M, 2) images and (M, 2, 2) Jacobians of points (M, 2)."""
    with np.errstate(invalid="ignore", over="ignore"):
        s = (points - fit.centre) / fit.scale
        images = fit.affine[0] + s @ fit.affine[1:]
        slopes = fit.affine[1:].T + 0 * s[:, np.newaxis, :]  # NaN in, NaN out, where nothing bends too
        if np.any(fit.weights):
            for rows, (x, y, square, logarithm) in _distances(fit, s):
                images[rows] += np.multiply(square, logarithm, out=square) @ fit.weights
                slope = np.multiply(logarithm, 2, out=logarithm)
                slope += 2
                slopes[rows, :, 0] += np.multiply(x, slope, out=x) @ fit.weights
                slopes[rows, :, 1] += np.multiply(y, slope, out=y) @ fit.weights
        slopes /= fit.scale
    return images, slopes


def _distances(fit: SplineFit, s: Array) -> Iterator[tuple[slice, Array]]:
    """Chunk by chunk: which rows, and x, y, r^2 and ln r^2 between them and all landmarks, to be overwritten."""
    across, along = np.ascontiguousarray(fit.landmarks.T)
    n = len(across)
    size = max(1, min(len(s), CHUNK // n))
    memory = np.empty((4, size, n))
    for begin in range(0, len(s), size):
        rows = slice(begin, begin + size)
        some = s[rows]
        held = memory[:, : len(some)]
        x, y, square, logarithm = held
        np.subtract(some[:, :1], across, out=x)
        np.subtract(some[:, 1:], along, out=y)
        np.multiply(x, x, out=square)
        np.multiply(y, y, out=logarithm)
        square += logarithm
        np.add(square, TINY, out=logarithm)
        np.log(logarithm, out=logarithm)
        yield rows, held
