"""A device whose driver lives in a process of its own: it may wait, the loop never does."""

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
"""[s] to connect, and to let go."""
NEAR = 0.05
"""[rad, m] by which a joint may be off the position that the device is expected at."""


class Reading(NamedTuple):
    """What a driver has just got from its device, as it came."""

    position: ArrayLike
    velocity: ArrayLike
    force: ArrayLike


class Driver(Protocol):
    """What the process of a device runs. Its calls may wait; each raises a DeviceLostError where it is gone."""

    def read(self) -> Reading | None:
        """What has come since the last call; None if nothing has."""
        ...

    def send(self, velocity: list[float]) -> None:
        """Joint velocities [rad/s, m/s], until others are sent."""
        ...

    def brake(self) -> None:
        """To rest, by the device's own means."""
        ...

    def keep_alive(self) -> None:
        """Show the device's watchdog that its driver is still there."""
        ...

    def close(self) -> None:
        """To rest, and let go of it."""
        ...


def sensed_layout(joints: int) -> np.dtype[Any]:
    """What the driver's process sends."""
    return np.dtype(
        [("stamp", "<f8"), ("position", "<f8", (joints,)), ("velocity", "<f8", (joints,)), ("force", "<f8", (3,)),
         ("sent", "<u8"), ("failure", "S240")]
    )  # fmt: skip


def commanded_layout(joints: int) -> np.dtype[Any]:
    """What it receives."""
    return np.dtype([("velocity", "<f8", (joints,))])


class RemoteDevice:
    """A `Device` of joint velocities; see its maker, such as `connect_ur`.

    Readings are stamped when they arrive. Without commands, the loop stopped or killed, the driver's process brakes the
    robot; without that process the robot's own watchdog does.

    Parameters
    ----------
    driver : name of the module in this package that has the driver. options : of the driver.
    joints : how many. dt : [s] of a tick. name : of the device, for messages.
    watchdog : [s] A device that has sent nothing for so long is lost; the driver brakes after half of it.
    fifo : of the driver's process, see `Loop`.
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
        """Of the driver's process."""
        return self._driver.id

    @property
    def measured(self) -> Measurement:
        """What arrived last. Raises a DeviceLostError where that is too long ago, or the driver says so."""
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
    def truth(self) -> Truth:
        """What is measured, and when it is now."""
        _, position, velocity, force = self.measured
        return Truth(time.monotonic(), position, velocity, np.zeros(self._joints), force)

    def reset(self, position: ArrayLike) -> Measurement:
        """Nothing is moved: what is measured, if the joints are at `position` (n,).

        Raises
        ------
        ConfigurationError : they are not.
        """
        seen = self.measured
        if not np.all(np.abs(np.asarray(position, dtype=np.float64) - seen.position) <= NEAR):
            raise ConfigurationError("position", position, f"where {self._name} is, {seen.position.round(3).tolist()}")
        return seen

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Send joint velocities (n,) [rad/s, m/s]; what arrived last. Nobody is pushed.

        Raises
        ------
        ConfigurationError : a velocity that is not finite.
        """
        seen = self.measured
        if not np.isfinite(command).all():
            raise ConfigurationError("command", command, f"{self._joints} finite velocities")
        self._commanded.write(velocity=command)
        return seen

    def stop(self) -> None:
        """Send zeros; without another command the driver brakes."""
        if not self._closed:
            self._commanded.write(velocity=0.0)

    def close(self) -> None:
        """Brake and let go."""
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
