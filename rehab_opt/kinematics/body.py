"""The mass of a robot's link."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Body", "of_a_body"]

Array = NDArray[np.float64]
ROUNDED = 1e-6
"""Share of the largest moment by which files of few digits round."""


class Body(NamedTuple):
    """A rigid body that moves with one link."""

    name: str
    link: int
    """Number of the row whose frame it is fixed to, from 1; 0 is the base frame of the chain, which no joint moves."""
    mass: float
    """[kg]"""
    centre: Array
    """(3,) centre of mass in that frame [m]."""
    inertia: Array
    """(3, 3) about the centre of mass, along that frame's axes [kg m^2]."""


def of_a_body(inertia: Array) -> bool:
    """Whether some body has this inertia (3, 3): no principal moment is negative, nor larger than the other two.

    Rounding of a millionth is let through. NaN fails.
    """
    if not np.all(np.isfinite(inertia)):
        return False
    least, middle, largest = np.linalg.eigvalsh(inertia).tolist()
    return bool(least >= -ROUNDED * largest and largest <= (least + middle) * (1 + ROUNDED))
