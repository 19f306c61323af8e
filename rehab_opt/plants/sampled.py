"""Base class of plants that simulate several physics steps per tick, with delays and noise."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.plants.channel import Channel, Commands, Sensors
from rehab_opt.plants.plant import Measurement, Truth

__all__ = ["SampledPlant"]

Array = NDArray[np.float64]


class SampledPlant(ABC):
    """A `Plant` with delays and noise; a subclass defines one physics step.

    Parameters
    ----------
    n : number of positions. dt : duration of a tick [s].
    channel : delays and noise; none by default.
    seed : seed of all random numbers, or a random generator.
    physics_step : largest duration of a physics step [s]; each tick has a whole number of steps.

    Raises
    ------
    ConfigurationError : the tick or the physics step is out of range.
    """

    def __init__(
        self, n: int, *, dt: float, channel: Channel | None, seed: int | np.random.Generator, physics_step: float
    ) -> None:
        if not 0.0 < dt < 1.0:
            raise ConfigurationError("dt", dt, "seconds above 0, below 1")
        if not 1e-6 <= physics_step <= 0.01:
            raise ConfigurationError("physics_step", physics_step, "seconds from 1e-6 to 0.01")
        self.n, self.dt = n, dt
        self.channel = Channel() if channel is None else channel
        self.rng = np.random.default_rng(seed)
        self._steps = max(1, math.ceil(dt / physics_step - 1e-9))
        self.physics_step = dt / self._steps
        self._now, self._tick = 0.0, 0

    @property
    def measured(self) -> Measurement:
        """The newest measurement."""
        return self._measured

    @property
    @abstractmethod
    def truth(self) -> Truth:
        """The current true state."""

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> Measurement:
        """Reset the time to zero and the robot to `position` (n,) [rad, m] with `velocity` (n,), by default zero.

        The random generator is not reset.
        """
        start = per_joint("position", position, self.n, finite=True)
        moving = per_joint("velocity", np.zeros(self.n) if velocity is None else velocity, self.n, finite=True)
        still = self._start(np.array(start), np.array(moving))
        self._commands, self._sensors = Commands(self.channel, self.rng, still), Sensors(self.channel, self.rng)
        self._now, self._tick = 0.0, 0
        self._sensors.keep(0.0, *self._readings())
        self._measured = self._sensors.read(0.0)
        return self._measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Simulate one tick with a `command` for the drive and a force `push` (3,) [N] on the hand."""
        begin, pushed = self._tick * self.dt, None if push is None else np.asarray(push, dtype=np.float64)
        self._commands.send(begin, np.array(command, dtype=np.float64))
        for k in range(self._steps):
            now = begin + k * self.physics_step
            self._advance(now, self._commands.at(now), pushed)
            self._now = now + self.physics_step
            self._sensors.keep(self._now, *self._readings())
        self._tick += 1
        self._now = self._tick * self.dt
        self._measured = self._sensors.read(self._now)
        return self._measured

    @abstractmethod
    def _start(self, position: Array, velocity: Array) -> Array:
        """Start at `position` (n,) with `velocity` (n,); return the command that acts before the first one arrives."""

    @abstractmethod
    def _advance(self, now: float, command: Array, push: Array | None) -> None:
        """Simulate one physics step from the time `now` [s]."""

    @abstractmethod
    def _readings(self) -> tuple[Array, Array, Array]:
        """True positions (n,), velocities (n,) and force on the hand (3,), as arrays that do not change later."""
