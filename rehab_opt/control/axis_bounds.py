"""Position, velocity, acceleration and jerk bounds of free axes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["AxisBounds", "axis_bounds"]


MAX_AXES = 10_000


class AxisBounds(NamedTuple):
    """Bounds of n free axes, each (n,) in u, u/s, u/s^2 and u/s^3 with u = rad or m."""

    lower: list[float]
    upper: list[float]
    velocity: list[float]
    acceleration: list[float]
    jerk: list[float]


def axis_bounds(
    *,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    axes: int | None = None,
) -> AxisBounds:
    """Bounds as a caller gives them, a scalar for all axes and None for no bound, or what is wrong with them."""
    given = {
        "lower": -math.inf if lower is None else lower,
        "upper": math.inf if upper is None else upper,
        "velocity": velocity,
        "acceleration": acceleration,
        "jerk": jerk,
    }
    n = axes if axes is not None else max(checked_array(name, value, "numbers").size for name, value in given.items())
    if not (isinstance(n, (int, np.integer)) and not isinstance(n, bool) and 1 <= n <= MAX_AXES):
        raise ConfigurationError("axes", axes, f"a whole number of axes from 1 to {MAX_AXES}")
    bounds = AxisBounds(**{name: per_joint(name, value, n).tolist() for name, value in given.items()})
    for name in ("velocity", "acceleration", "jerk"):
        if not all(0.0 < number < math.inf for number in getattr(bounds, name)):
            raise ConfigurationError(name, given[name], "positive finite numbers")
    for low, high in zip(bounds.lower, bounds.upper, strict=True):
        if not (low <= high and low < math.inf and high > -math.inf):
            raise ConfigurationError("lower, upper", (low, high), "lower <= upper, neither NaN")
    return bounds
