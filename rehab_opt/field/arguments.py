"""Checks of a field's arguments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.assembly import DragAlong
from rehab_opt.field.samples import SampledPath, arc_length, interpolated
from rehab_opt.kinematics.real_array import checked_array, is_finite

__all__ = ["as_point", "as_points", "checked_drag", "path_stiffness", "per_axis"]

Array = NDArray[np.float64]


def checked_drag(drag: object, along: DragAlong, rest_on_target: bool) -> float:
    """The drag k1 as a float; its sign must suit `along` and `rest_on_target`."""
    if not is_finite(drag):
        raise ConfigurationError("drag", drag, "a finite number")
    if drag < 0 and along == "travelled":
        raise ConfigurationError("drag", drag, "a drag of zero or more: along the travelled length it resists")
    if drag < 0 and rest_on_target:
        raise ConfigurationError(
            "drag", drag, "drag_along='travelled' to resist, or rest_on_target=False for the published form"
        )
    return float(drag)


def per_axis(argument: str, value: ArrayLike) -> Array:
    """(2,) value for each axis; `value` is one number for both axes, or two, and not negative."""
    array = checked_array(argument, value, "one or two numbers")
    if array.shape not in ((), (1,), (2,)):
        raise ConfigurationError(argument, value, "one or two numbers")
    if not (np.all(array >= 0) and np.all(np.isfinite(array))):
        raise ConfigurationError(argument, value, "finite numbers of zero or more")
    return np.broadcast_to(array, (2,)).copy()


def path_stiffness(value: Any, given: Sequence[Array], paths: Sequence[SampledPath]) -> list[Array]:
    """Stiffness (m, 2) [N/m] of every sample, one array per path."""
    several = isinstance(value, list | tuple) and len(value) and all(np.ndim(each) > 0 for each in value)
    if not several and np.shape(value) in ((), (2,)):
        same = per_axis("stiffness", value)
        return [np.broadcast_to(same, path.points.shape) for path in paths]
    each = list(value) if several and len(value) == len(given) else [value]
    if len(each) != len(given):
        raise ConfigurationError(
            "stiffness", f"{len(each)} entries", f"a number, two, or one array for {len(given)} paths"
        )
    stiff = []
    for points, path, array in zip(given, paths, each, strict=True):
        numbers = checked_array("stiffness", array, "numbers, one a point")
        if numbers.shape not in ((len(points),), points.shape):
            raise ConfigurationError("stiffness", numbers.shape, f"({len(points)},) or {points.shape}: one a point")
        if not (np.all(numbers >= 0) and np.all(np.isfinite(numbers))):
            raise ConfigurationError("stiffness", array, "finite numbers of zero or more")
        numbers = np.broadcast_to(numbers.reshape(len(points), -1), points.shape)
        still = arc_length(points)[-1] == 0
        stiff.append(numbers[:1].copy() if still else interpolated(points, numbers, path.travelled))
    return stiff


def as_point(x: ArrayLike) -> Array:
    """`x` as one point (2,)."""
    point = as_points(x)
    if point.shape != (2,):
        raise ConfigurationError("x", point.shape, "a point (2,) in metres")
    return point


def as_points(x: ArrayLike) -> Array:
    """`x` as one point (2,) or several (N, 2)."""
    expected = "points (2,) or (N, 2) in metres"
    points = checked_array("x", x, expected)
    if points.ndim not in {1, 2} or points.shape[-1] != 2:
        raise ConfigurationError("x", points.shape, expected)
    return points
