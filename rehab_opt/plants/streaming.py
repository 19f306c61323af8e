"""A robot that takes positions, for a controller that commands velocities."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.plants.plant import Measurement, Plant, Truth

__all__ = ["PositionStream"]

Array = NDArray[np.float64]


class PositionStream:
    """Sums velocities to a reference of its own and streams it to a plant of positions; a `Plant`.

    The reference begins where the robot is reset and never looks at the sensors again: what industrial interfaces of
    positions expect. It runs away from a joint that is blocked.

    Parameters
    ----------
    plant : whose commands are positions, such as a `MujocoArm` with a `PositionServo`.
    """

    reference: Array
    """(n,) [rad, m] what was streamed last."""

    def __init__(self, plant: Plant) -> None:
        self._plant, self.dt = plant, plant.dt
        self.reference = plant.truth.position

    @property
    def measured(self) -> Measurement:
        """The plant's."""
        return self._plant.measured

    @property
    def truth(self) -> Truth:
        """The plant's."""
        return self._plant.truth

    def reset(self, position: ArrayLike) -> Measurement:
        """At rest at `position` (n,), the reference there."""
        self.reference = np.array(position, dtype=np.float64)
        return self._plant.reset(position)

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """One tick at the velocities `command` (n,) [rad/s, m/s]."""
        self.reference = self.reference + np.asarray(command, dtype=np.float64) * self.dt
        return self._plant.step(self.reference, push)
