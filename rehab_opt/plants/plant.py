"""Interface of plants: robots that take a command in each tick and return measurements and a separate true state."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Device", "Measurement", "Plant", "PositionStream", "Truth"]

Array = NDArray[np.float64]


class Measurement(NamedTuple):
    """Sensor values with a time stamp; input of a controller."""

    stamp: float
    """Time [s] at which the sensors were read, on the plant's clock."""
    position: Array
    """Joint positions (n,) [rad, m]."""
    velocity: Array
    """Joint velocities (n,) [rad/s, m/s]."""
    force: Array
    """Contact force (3,) or (2,) [N] on the hand, in the base frame."""


class Truth(NamedTuple):
    """True state of a plant; controllers do not get it."""

    time: float
    """Current time [s] on the plant's clock."""
    position: Array
    """Joint positions (n,) [rad, m]."""
    velocity: Array
    """Joint velocities (n,) [rad/s, m/s]."""
    effort: Array
    """Efforts (n,) [N m, N] of the drives before friction; zero in a plant without masses."""
    force: Array
    """Contact force (3,) or (2,) [N] on the hand, in the base frame."""


class Plant(Protocol):
    """A robot in closed loop; each call of `step` is one tick of `dt`.

    A plant sends a tick's command at the beginning of the tick and simulates all delays. The plant's drive takes joint
    velocities, joint positions or a force.
    """

    dt: float
    """Duration of a tick [s]."""

    @property
    def measured(self) -> Measurement:
        """The newest measurement."""
        ...

    @property
    def truth(self) -> Truth:
        """The current true state."""
        ...

    def reset(self, position: ArrayLike) -> Measurement:
        """Place the robot at rest at `position` (n,), reset the time to zero, and return the measurement."""
        ...

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Run one tick with `command`; return the measurement at the tick's end.

        Parameters
        ----------
        command : input of the drive: joint velocities [rad/s, m/s], joint positions [rad, m] or a force [N].
        push : additional force (3,) or (2,) [N] on the hand during the tick, in the base frame.
        """
        ...


class Device(Plant, Protocol):
    """A physical robot as a `Plant`; `step` sends the command and returns at once.

    `measured` is the last received state, and `truth` repeats it; both use the clock of `time.monotonic`. `reset` does
    not move the robot; it raises an error if the robot is not at the given position. If the device is lost, all methods
    but `stop` raise `DeviceLostError`.
    """

    def stop(self) -> None:
        """Stop the device with its own stop function; a lost device raises no error here."""
        ...

    def close(self) -> None:
        """Brake and disconnect; the object cannot be used afterwards."""
        ...


class PositionStream:
    """Integrates commanded velocities to positions and sends them to a position-controlled plant; a `Plant`.

    The integrated positions start at the reset position and ignore the sensors, as industrial position interfaces
    expect. If a joint is blocked, its commanded position therefore moves ever further away.

    Parameters
    ----------
    plant : plant with position commands, such as a `MujocoArm` with a `PositionServo`.
    """

    reference: Array
    """Last commanded joint positions (n,) [rad, m]."""

    def __init__(self, plant: Plant) -> None:
        self._plant, self.dt = plant, plant.dt
        self.reference = plant.truth.position

    @property
    def measured(self) -> Measurement:
        """Measurement of the position-controlled plant."""
        return self._plant.measured

    @property
    def truth(self) -> Truth:
        """True state of the position-controlled plant."""
        return self._plant.truth

    def reset(self, position: ArrayLike) -> Measurement:
        """Reset the plant and the commanded positions to rest at `position` (n,)."""
        self.reference = np.array(position, dtype=np.float64)
        return self._plant.reset(position)

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Run one tick at the velocities `command` (n,) [rad/s, m/s]."""
        self.reference = self.reference + np.asarray(command, dtype=np.float64) * self.dt
        return self._plant.step(self.reference, push)
