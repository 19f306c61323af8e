"""The mass of a robot's link."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import is_real, real_array

__all__ = ["Body", "checked_bodies", "of_a_body"]

Array = NDArray[np.float64]
ROUNDED = 1e-6
"""Accepted rounding error of a file's inertias, as a fraction of the largest moment."""


class Body(NamedTuple):
    """A rigid body that moves with one link."""

    name: str
    link: int
    """Number of the row with whose frame the body moves, from 1; 0 is the base frame, which no joint moves."""
    mass: float
    """[kg]"""
    centre: Array
    """(3,) centre of mass in that frame [m]."""
    inertia: Array
    """(3, 3) about the centre of mass, along that frame's axes [kg m^2]."""


def of_a_body(inertia: ArrayLike) -> bool:
    """Whether a real body can have this inertia (3, 3).

    Each principal moment must be between 0 and the sum of the other two. Violations up to 1e-6 of the largest moment
    are accepted. NaN and asymmetric matrices give False.
    """
    try:
        matrix = real_array(inertia)
    except (TypeError, ValueError, OverflowError):
        return False
    if matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)):
        return False
    least, middle, largest = np.linalg.eigvalsh(matrix).tolist()
    if not np.all(np.abs(matrix - matrix.T) <= ROUNDED * largest):
        return False
    return bool(least >= -ROUNDED * largest and largest <= (least + middle) * (1 + ROUNDED))


def checked_bodies(bodies: Sequence[Body], n: int) -> tuple[Body, ...]:
    """The bodies, checked to be on one of the links 1 to n.

    Raises
    ------
    ConfigurationError : a body on no link, a negative mass, an impossible inertia.
    """
    for body in bodies:
        if not (isinstance(body, Body) and 1 <= body.link <= n and is_real(body.mass) and 0.0 <= body.mass < math.inf):
            raise ConfigurationError("bodies", body, f"masses of 0 kg or more on links 1 to {n}")
        if not of_a_body(body.inertia):
            expected = "one that a body has: no principal moment negative or above the other two together"
            raise ConfigurationError(f"bodies, inertia of {body.name}", np.asarray(body.inertia).tolist(), expected)
    return tuple(bodies)
