"""Interface of plants: robots that take a command each tick and return measurements, with the truth apart."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Device", "Measurement", "Plant", "PositionStream", "Truth"]

Array = NDArray[np.float64]


class Measurement(NamedTuple):
    """Sensor values and their time stamp, the input of a controller."""

    stamp: float
    """[s] when the sensors were read, on the plant's clock; earlier than now by the measurement delay."""
    position: Array
    """(n,) [rad, m]"""
    velocity: Array
    """(n,) [rad/s, m/s]"""
    force: Array
    """(3,) or (2,) [N] on the hand by whatever touches it, in the base frame."""


class Truth(NamedTuple):
    """The true state, which no controller gets."""

    time: float
    """[s] now."""
    position: Array
    """(n,) [rad, m]"""
    velocity: Array
    """(n,) [rad/s, m/s]"""
    effort: Array
    """(n,) effort of the drives before friction [N m, N]; zero in a plant without masses."""
    force: Array
    """(3,) or (2,) [N] on the hand by whatever touches it, in the base frame."""


class Plant(Protocol):
    """A robot in closed loop. One call of `step` is one tick of `dt`.

    The command of a tick is sent at its beginning; delays and effects are inside the plant. One loop serves all plants;
    the plant's drive takes velocities, positions or forces.
    """

    dt: float
    """[s] of a tick."""

    @property
    def measured(self) -> Measurement:
        """The latest measurement."""
        ...

    @property
    def truth(self) -> Truth:
        """The true state now."""
        ...

    def reset(self, position: ArrayLike) -> Measurement:
        """Reset to rest at `position` (n,), time zero, empty channels; returns the measurement."""
        ...

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """One tick under `command`; returns the measurement at its end.

        Parameters
        ----------
        command : input of the drive: joint velocities [rad/s, m/s], joint positions [rad, m] or a force [N].
        push : (3,) or (2,) [N] additional force on the hand during the tick, in the base frame.
        """
        ...


class Device(Plant, Protocol):
    """A physical robot as a `Plant`; `step` sends the command and returns at once.

    `measured` is the last received state; its stamp and `truth.time` are on the clock of `time.monotonic`. `truth`
    repeats the measurement. All methods raise `DeviceLostError` if the device is gone. `reset` moves nothing; it
    refuses a position other than the device's.
    """

    def stop(self) -> None:
        """Make the device brake by its own means; no error if it is gone."""
        ...

    def close(self) -> None:
        """Brake and disconnect; the object cannot be used afterwards."""
        ...


class PositionStream:
    """Integrates velocities to a position reference and streams it to a position-controlled plant; a `Plant`.

    The reference starts at the reset position and ignores the sensors afterwards, as industrial position interfaces
    expect. It runs away from a blocked joint.

    Parameters
    ----------
    plant : plant with position commands, such as a `MujocoArm` with a `PositionServo`.
    """

    reference: Array
    """(n,) [rad, m] last streamed position."""

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
        """Reset plant and reference to rest at `position` (n,)."""
        self.reference = np.array(position, dtype=np.float64)
        return self._plant.reset(position)

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """One tick at the velocities `command` (n,) [rad/s, m/s]."""
        self.reference = self.reference + np.asarray(command, dtype=np.float64) * self.dt
        return self._plant.step(self.reference, push)
