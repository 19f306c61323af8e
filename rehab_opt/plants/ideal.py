"""Simulated joints that move exactly as commanded, without delay."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.plants.plant import Measurement, Truth

__all__ = ["IdealJoints"]

Array = NDArray[np.float64]


class IdealJoints:
    """A `Plant` whose joints follow q(t + dt) = q(t) + command * dt exactly, measured without delay and noise.

    External forces do not move the joints.

    Parameters
    ----------
    dt : duration of a tick [s].
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._tick = 0
        self._position: Array = np.zeros(0)
        self._velocity: Array = np.zeros(0)
        self._push: Array = np.zeros(3)

    @property
    def measured(self) -> Measurement:
        """The true state as a measurement."""
        return Measurement(self._tick * self.dt, self._position, self._velocity, self._push)

    @property
    def truth(self) -> Truth:
        """The true state."""
        return Truth(self._tick * self.dt, self._position, self._velocity, np.zeros(len(self._position)), self._push)

    def reset(self, position: ArrayLike) -> Measurement:
        """Start at rest at `position` (n,) [rad, m]."""
        self._tick = 0
        self._position = np.array(position, dtype=np.float64)
        self._velocity = np.zeros(len(self._position))
        self._push = np.zeros(3)
        return self.measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Simulate one tick at `command` (n,) [rad/s, m/s]; `push` (3,) [N] changes only the measured force."""
        self._velocity = np.asarray(command, dtype=np.float64)
        self._push = np.zeros(3) if push is None else np.array(push, dtype=np.float64)
        self._position = self._position + self._velocity * self.dt
        self._tick += 1
        return self.measured
