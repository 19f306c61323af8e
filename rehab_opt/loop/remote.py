"""A device whose driver runs in a separate process, so that the loop never waits for the device."""

from __future__ import annotations

import time
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.companion import Companion
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.plants.plant import Measurement, Truth

__all__ = ["Driver", "Reading", "RemoteDevice", "commanded_layout", "sensed_layout"]

Array = NDArray[np.float64]

PATIENCE, ENDING = 15.0, 5.0
"""Longest times [s] to connect and to disconnect."""
NEAR = 0.05
"""Largest deviation [rad, m] of a joint from the expected start position."""


class Reading(NamedTuple):
    """Newest state that a driver received from its device."""

    position: ArrayLike
    velocity: ArrayLike
    force: ArrayLike
    scaling: float = 1.0
    """Fraction of the commanded speed at which the device runs, as set by the speed slider of its pendant."""


class Driver(Protocol):
    """Driver of a device in a process of its own; methods may wait, and raise DeviceLostError if it is lost."""

    def read(self) -> Reading | None:
        """The newest state of the device; None if there is no new one since the last call."""
        ...

    def send(self, velocity: list[float]) -> None:
        """Command joint velocities [rad/s, m/s], which hold until the next command."""
        ...

    def brake(self) -> None:
        """Brake to rest with the device's own stop function."""
        ...

    def keep_alive(self) -> None:
        """Reset the device's watchdog."""
        ...

    def close(self) -> None:
        """Brake to rest and disconnect."""
        ...


def sensed_layout(joints: int) -> np.dtype[Any]:
    """Layout of the records that the driver's process sends to the loop."""
    return np.dtype(
        [("stamp", "<f8"), ("position", "<f8", (joints,)), ("velocity", "<f8", (joints,)), ("force", "<f8", (3,)),
         ("scaling", "<f8"), ("sent", "<u8"), ("failure", "S240")]
    )  # fmt: skip


def commanded_layout(joints: int) -> np.dtype[Any]:
    """Layout of the records that the loop sends to the driver's process."""
    return np.dtype([("velocity", "<f8", (joints,))])


class RemoteDevice:
    """A `Device` with joint velocity commands, made by functions such as `connect_ur`.

    The driver's process stamps each reading on arrival. If the loop stops or is killed, the driver's process brakes the
    robot. If the driver's process ends, the robot's own watchdog brakes the robot.

    Parameters
    ----------
    driver : name of the driver's module in `rehab_opt.loop`. options : arguments of the driver.
    joints : number of joints. dt : duration of a tick [s]. name : name of the device in messages.
    watchdog : time [s] without a reading after which the device counts as lost. The driver brakes after half of this
        time without a command.
    fifo : SCHED_FIFO priority of the driver's process, as for `Loop`.
    """

    def __init__(
        self,
        driver: str,
        options: dict[str, Any],
        *,
        joints: int,
        dt: float,
        name: str,
        watchdog: float,
        fifo: int | None = None,
    ) -> None:
        if not 1e-4 <= dt <= 0.1:
            raise ConfigurationError("dt", dt, "seconds from 0.0001 to 0.1")
        if not 0.02 <= watchdog <= 5.0:
            raise ConfigurationError("watchdog", watchdog, "seconds from 0.02 to 5")
        self.dt, self._name, self._joints, self._watchdog = dt, name, joints, watchdog
        self._sensed, self._commanded = (
            SharedRing.create(layout(joints), depth=64) for layout in (sensed_layout, commanded_layout)
        )
        orders = {
            "silent": watchdog / 2,
            "fifo": fifo,
            "driver": driver,
            "options": options,
            "sensed": self._sensed.name,
            "commanded": self._commanded.name,
        }
        self._driver = Companion("rehab_opt.loop.remote_process", orders)
        self._closed = False
        until = time.monotonic() + PATIENCE
        while self._sensed.latest() is None and self._driver.ended is None and time.monotonic() < until:
            time.sleep(0.005)
        newest = self._sensed.latest()
        if newest is None or newest.record["failure"]:
            why = "no answer" if newest is None else newest.record["failure"].decode(errors="replace")
            self.close()
            raise DeviceLostError(f"{name} cannot be connected: {why}")

    @property
    def process_id(self) -> int:
        """Process id of the driver's process."""
        return self._driver.id

    @property
    def measured(self) -> Measurement:
        """The last reading; raises DeviceLostError if the reading is too old or the driver reports a failure."""
        newest = None if self._closed else self._sensed.latest()
        if newest is None:
            raise DeviceLostError(f"{self._name} was closed")
        record = newest.record
        if record["failure"]:
            raise DeviceLostError(f"{self._name}: {record['failure'].decode(errors='replace')}")
        ago = time.monotonic() - float(record["stamp"])
        if not ago <= self._watchdog:
            gone = "; the process of its driver is gone" if self._driver.ended is not None else ""
            raise DeviceLostError(f"{self._name} has sent nothing for {1e3 * ago:.0f} ms{gone}")
        return Measurement(
            float(record["stamp"]), record["position"].copy(), record["velocity"].copy(), record["force"].copy()
        )

    @property
    def scaling(self) -> float:
        """Fraction of the commanded speed at which the device runs; 1 for a device that does not report it."""
        newest = None if self._closed else self._sensed.latest()
        return 1.0 if newest is None else float(newest.record["scaling"])

    @property
    def truth(self) -> Truth:
        """The measured state with the current time, since a device's true state is unknown."""
        _, position, velocity, force = self.measured
        return Truth(time.monotonic(), position, velocity, np.zeros(self._joints), force)

    def reset(self, position: ArrayLike) -> Measurement:
        """Check that the joints are at `position` (n,) [rad, m] and return the measurement; the robot does not move.

        Raises
        ------
        ConfigurationError : a joint is more than 0.05 rad or m away.
        """
        seen = self.measured
        if not np.all(np.abs(np.asarray(position, dtype=np.float64) - seen.position) <= NEAR):
            raise ConfigurationError("position", position, f"where {self._name} is, {seen.position.round(3).tolist()}")
        return seen

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Send joint velocities (n,) [rad/s, m/s]; return the last reading. `push` is ignored.

        Raises
        ------
        ConfigurationError : a velocity is not finite.
        """
        seen = self.measured
        if not np.isfinite(command).all():
            raise ConfigurationError("command", command, f"{self._joints} finite velocities")
        self._commanded.write(velocity=command)
        return seen

    def stop(self) -> None:
        """Command zero velocities; the driver brakes if no further command follows."""
        if not self._closed:
            self._commanded.write(velocity=0.0)

    def close(self) -> None:
        """Brake and disconnect."""
        if self._closed:
            return
        self._closed = True
        self._driver.end(ENDING)
        self._sensed.close()
        self._commanded.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
