"""Channel between a controller and its robot: delays and jitter of commands and measurements, and sensor noise."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.plants.plant import Measurement

__all__ = ["Channel", "Commands", "Sensors"]

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""Tolerance [s] for rounding errors: a command that is due within this time counts as arrived."""
SLOWEST = 10.0
"""Largest accepted delay [s]; a larger value is probably in another unit."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Delays, jitter and noise between a controller and its robot; zero means none.

    A command sent at time t acts from t + command_delay + u on, with u uniform in [0, command_jitter]. A measurement
    received at t was taken at t - measurement_delay - w, with w uniform in [0, measurement_jitter]. Commands and
    measurements keep their order. Noise is normal and white, with one draw per tick and component.

    Parameters
    ----------
    command_delay, command_jitter, measurement_delay, measurement_jitter : times [s], exact to one physics step.
    position_noise, velocity_noise : standard deviations [rad, m; rad/s, m/s].
    position_resolution : resolution of the encoders [rad, m], 0 for none; noise is added before rounding.
    force_noise : standard deviation of each force component [N].

    Raises
    ------
    ConfigurationError : a number is negative or infinite, or a delay is above 10 s.
    """

    command_delay: float = 0.0
    command_jitter: float = 0.0
    measurement_delay: float = 0.0
    measurement_jitter: float = 0.0
    position_noise: float = 0.0
    position_resolution: float = 0.0
    velocity_noise: float = 0.0
    force_noise: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            most = SLOWEST if name.endswith(("delay", "jitter")) else math.inf
            if not (isinstance(value, (int, float)) and 0.0 <= value <= most and value < math.inf):
                expected = "a finite number of zero or more" + (f", at most {most:g} s" if most < math.inf else "")
                raise ConfigurationError(name, value, expected)


class Commands:
    """Queue of commands that were sent and do not act yet."""

    def __init__(self, channel: Channel, rng: np.random.Generator, first: Array) -> None:
        self._delay, self._jitter, self._rng = channel.command_delay, channel.command_jitter, rng
        self._underway: deque[tuple[float, Array]] = deque()
        self._arrived = first

    def send(self, time: float, command: Array) -> None:
        """Send a command at `time` [s]."""
        late = self._delay + (self._jitter * self._rng.random() if self._jitter else 0.0)
        self._underway.append((time + late, command))

    def at(self, time: float) -> Array:
        """The command that acts on the robot at `time` [s]."""
        while self._underway and self._underway[0][0] <= time + ROUNDING:
            self._arrived = self._underway.popleft()[1]
        return self._arrived


class _Reading(NamedTuple):
    time: float
    position: Array
    velocity: Array
    force: Array


class Sensors:
    """Queue of past states that the sensors report after the measurement delay."""

    def __init__(self, channel: Channel, rng: np.random.Generator) -> None:
        self._channel, self._rng = channel, rng
        self._kept: deque[_Reading] = deque()

    def keep(self, time: float, position: Array, velocity: Array, force: Array) -> None:
        """Store the true state at `time` [s]; the caller must not change the arrays afterwards."""
        self._kept.append(_Reading(time, position, velocity, force))

    def read(self, time: float) -> Measurement:
        """The newest measurement that is available at `time` [s], with noise."""
        channel, rng, kept = self._channel, self._rng, self._kept
        late = channel.measurement_delay
        if channel.measurement_jitter:
            late += channel.measurement_jitter * rng.random()
        while len(kept) > 1 and kept[1].time <= time - late + ROUNDING:
            kept.popleft()
        stamp, position, velocity, force = kept[0]
        if channel.position_noise:
            position = position + channel.position_noise * rng.standard_normal(len(position))
        if channel.position_resolution:
            position = channel.position_resolution * np.round(position / channel.position_resolution)
        if channel.velocity_noise:
            velocity = velocity + channel.velocity_noise * rng.standard_normal(len(velocity))
        if channel.force_noise:
            force = force + channel.force_noise * rng.standard_normal(len(force))
        return Measurement(stamp, position, velocity, force)
