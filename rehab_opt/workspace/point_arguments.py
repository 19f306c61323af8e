"""Point arguments: one point as two numbers in an array, tuple or list, or several as rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["one_point", "point_array", "real_number", "single_point"]

Array = NDArray[np.float64]
_FLOATS = np.dtype(np.float64)
_EXPECTED = "points (2,) or (N, 2), numbers in metres"


def one_point(points: ArrayLike) -> tuple[float, float] | None:
    """Coordinates of a point (2,) as two floats; None for other input, which `point_array` handles."""
    if type(points) is np.ndarray:
        if points.dtype is _FLOATS and points.shape == (2,):  # the usual case in a tick
            x, y = points.tolist()
            return x, y
    elif isinstance(points, tuple | list) and len(points) == 2:
        x, y = points
        if isinstance(x, float) and isinstance(y, float):
            return float(x), float(y)
    rows = checked_array("points", points, _EXPECTED)
    return (float(rows[0]), float(rows[1])) if rows.shape == (2,) else None


def single_point(point: ArrayLike) -> tuple[float, float]:
    """Coordinates of one point (2,) as two floats.

    Raises
    ------
    ConfigurationError : anything else; the error names `point`.
    """
    if type(point) is np.ndarray and point.dtype is _FLOATS and point.shape == (2,):
        x, y = point.tolist()
        return x, y
    if isinstance(point, tuple) and len(point) == 2:  # from a gate in a tick
        x, y = point
        if isinstance(x, float) and isinstance(y, float):
            return float(x), float(y)
    row = checked_array("point", point, "two numbers in metres")
    if row.shape != (2,):
        raise ConfigurationError("point", f"an array of shape {row.shape}", "two numbers in metres")
    return float(row[0]), float(row[1])


def point_array(points: ArrayLike, argument: str = "points") -> Array:
    """`points` as an array: (2,) for one point, (N, 2) for several.

    Raises
    ------
    ConfigurationError : a wrong shape, or no numbers; the error names `argument`.
    """
    array = checked_array(argument, points, _EXPECTED)
    if array.ndim not in {1, 2} or array.shape[-1] != 2:
        raise ConfigurationError(argument, f"an array of shape {array.shape}", _EXPECTED)
    return array


def real_number(value: object) -> float:
    """`value` as a float; NaN if it is no number (a string, None, bool or array)."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits
        return math.inf if value > 0 else -math.inf
