"""The mass of a robot's link."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Body"]

Array = NDArray[np.float64]


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
