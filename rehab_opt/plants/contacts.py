"""Contacts of a hand.

They are springs and dampers of a stated stiffness, so that an impact's peak force follows a formula. The stiffness of
MuJoCo's own contacts depends on its solver.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import real_array

__all__ = ["Contact", "Wall"]

Array = NDArray[np.float64]


class Contact(Protocol):
    """A contact that acts on the hand."""

    def force(self, time: float, position: Array, velocity: Array) -> Array:
        """(k,) [N] force on a hand at `position` (k,) [m] with `velocity` (k,) [m/s] at `time` [s]."""
        ...


class Wall:
    """A frictionless plane with the normal force stiffness * depth + damping * depth', never pulling.

    Parameters
    ----------
    point : (k,) [m] on the plane. normal : (k,) out of the wall, of any length.
    stiffness : [N/m]. damping : [N s/m], on the way in.
    """

    def __init__(self, point: ArrayLike, normal: ArrayLike, *, stiffness: float = 3e4, damping: float = 100.0) -> None:
        at, out = real_array(point), real_array(normal)
        length = float(np.linalg.norm(out))
        if not (at.shape == out.shape and at.ndim == 1 and 0.0 < length < math.inf and np.all(np.isfinite(at))):
            raise ConfigurationError("normal", normal, "a direction of as many components as point")
        self._normal = out / length
        self._offset = float(self._normal @ at)
        self._stiffness, self._damping = _amount("stiffness", stiffness), _amount("damping", damping)

    def depth(self, position: Array) -> float:
        """[m] into the wall, negative outside."""
        return self._offset - float(self._normal @ position)

    def force(self, time: float, position: Array, velocity: Array) -> Array:
        """Force out of the wall, zero outside."""
        depth = self.depth(position)
        if not depth > 0.0:
            return np.zeros(len(position))
        sinking = max(0.0, -float(self._normal @ velocity))  # a wall that is left lets go
        pushed: Array = (self._stiffness * depth + self._damping * sinking) * self._normal
        return pushed


def _amount(name: str, value: float) -> float:
    if not 0.0 <= value < math.inf:
        raise ConfigurationError(name, value, "a finite number of zero or more")
    return float(value)
