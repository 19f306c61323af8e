"""What every plant is: a robot that takes a command each tick and shows what its sensors say, apart from the truth."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Device", "Measurement", "Plant", "PositionStream", "Truth"]

Array = NDArray[np.float64]


class Measurement(NamedTuple):
    """What a controller may know: sensor values, and when they were read."""

    stamp: float
    """[s] when the sensors were read, on the plant's clock; older than now by the delay of the measurement."""
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
    """(n,) what the drives exert, friction not subtracted [N m, N]; zeros where nothing has a mass."""
    force: Array
    """(3,) or (2,) [N] on the hand by whatever touches it, in the base frame."""


class Plant(Protocol):
    """A robot in closed loop. One call of `step` is one tick of `dt`.

    The command of a tick is sent at its beginning; what arrives when, and what comes of it, is the plant's matter. A
    controller that is made for another plant needs no other loop: velocities, positions or forces are what the
    plant's drive takes.
    """

    dt: float
    """[s] of a tick."""

    @property
    def measured(self) -> Measurement:
        """What the sensors say now."""
        ...

    @property
    def truth(self) -> Truth:
        """What is so now."""
        ...

    def reset(self, position: ArrayLike) -> Measurement:
        """At rest at `position` (n,), the clock at zero, nothing on its way; what the sensors say then."""
        ...

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """One tick under `command`; what the sensors say at its end.

        Parameters
        ----------
        command : what the drive takes: joint velocities [rad/s, m/s], joint positions [rad, m] or a force [N].
        push : (3,) or (2,) [N] on the hand during the tick, in the base frame, besides the plant's own contacts.
        """
        ...


class Device(Plant, Protocol):
    """A robot that is there, as a `Plant`; `step` sends the command and returns at once.

    `measured` is what arrived last, its stamp and `truth.time` on one clock, that of `time.monotonic`; `truth` repeats
    what was measured, since nobody knows better. All of them raise a `DeviceLostError` where the device is gone.
    `reset` moves nothing: it refuses a position that the device is not at.
    """

    def stop(self) -> None:
        """Have it come to rest by its own means; no error where it is gone."""
        ...

    def close(self) -> None:
        """The same, and let go of it: the object is of no use any more."""
        ...


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
