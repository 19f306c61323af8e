"""Contacts of a hand, as springs and dampers.

With a known stiffness, the peak force of an impact follows from a formula; the stiffness of MuJoCo's own contacts
depends on its solver.
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
    """A contact that exerts a force on the hand."""

    def force(self, time: float, position: Array, velocity: Array) -> Array:
        """Force (k,) [N] on a hand at `position` (k,) [m] with `velocity` (k,) [m/s] at `time` [s]."""
        ...


class Wall:
    """A frictionless plane that pushes the hand out with the force stiffness * d + damping * max(d', 0).

    d [m] is the depth of the hand behind the plane; outside, where d < 0, the force is zero.

    Parameters
    ----------
    point : point (k,) [m] on the plane. normal : direction (k,) out of the wall, of any length.
    stiffness : stiffness [N/m]. damping : damping [N s/m] while the hand moves into the wall.
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
        """Depth [m] of a position (k,) [m] behind the plane; negative outside."""
        return self._offset - float(self._normal @ position)

    def force(self, time: float, position: Array, velocity: Array) -> Array:
        """Force (k,) [N] of the wall on the hand; zero outside."""
        depth = self.depth(position)
        if not depth > 0.0:
            return np.zeros(len(position))
        sinking = max(0.0, -float(self._normal @ velocity))  # no damping on the way out: a wall does not pull
        pushed: Array = (self._stiffness * depth + self._damping * sinking) * self._normal
        return pushed


def _amount(name: str, value: float) -> float:
    if not 0.0 <= value < math.inf:
        raise ConfigurationError(name, value, "a finite number of zero or more")
    return float(value)
