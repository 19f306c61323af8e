"""Universal Robots' arms, through ur_rtde."""

from __future__ import annotations

import time
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.remote import Reading, RemoteDevice

__all__ = ["UrDriver", "connect_ur", "driver"]

JOINTS = 6
ACCELERATION = 40.0
"""[rad/s^2] Largest value for speedj; our controllers' bounds are lower, and a lower value here would add lag."""
BRAKE = 10.0
"""[rad/s^2]"""
TOLD = 0.05
"""[s] within which the packages report why a command was refused."""
WATCHDOG = 0.1
"""[s]"""
RECIPE = [
    "timestamp", "actual_q", "actual_qd", "actual_TCP_force", "safety_status_bits", "speed_scaling",
    "target_speed_fraction",
]  # fmt: skip
"""Fields that the robot sends."""


def connect_ur(
    host: str, *, rate_hz: float = 500.0, watchdog: float = WATCHDOG, fifo: int | None = None
) -> RemoteDevice:
    """Connect to a robot in remote control, as a `Device` with joint velocity commands (`speedj`).

    ur_rtde runs in its own process. It starts a program on the robot that stops the robot if no data arrive.

    Parameters
    ----------
    host : address of the robot's controller. rate_hz : of the loop; the robot runs at 500 Hz, a CB3 at 125 Hz.
    watchdog : [s] without a package after which the robot stops and counts as lost.
    fifo : priority of that process, see `Loop`; on a busy machine it must run in time like the loop.

    Raises
    ------
    ConfigurationError : ur_rtde is not installed (extra `ur`). DeviceLostError : no connection to the robot.
    """
    if find_spec("rtde_control") is None:
        raise ConfigurationError("host", host, "ur_rtde, which is not installed: pip install 'rehab_opt[ur]'")
    return RemoteDevice(
        "ur",
        {"host": host, "watchdog": watchdog},
        joints=JOINTS,
        dt=1 / rate_hz,
        name=f"UR at {host}",
        watchdog=watchdog,
        fifo=fifo,
    )


class UrDriver:
    """A `Driver` for UR; raises DeviceLostError if the robot does not answer or is stopped."""

    def __init__(self, host: str, watchdog: float) -> None:
        try:
            self._receive: Any = import_module("rtde_receive").RTDEReceiveInterface(host, -1.0, RECIPE)
            self._control: Any = import_module("rtde_control").RTDEControlInterface(host)
            self._control.setWatchdog(1 / watchdog)
        except RuntimeError as refused:  # of C++: what std::exception is in Python
            raise DeviceLostError(str(refused)) from refused
        self._last = -1.0

    def read(self) -> Reading | None:
        """The newest package, or None."""
        receive = self._receive
        if not receive.isConnected():
            raise DeviceLostError("the connection is closed")
        stamp = receive.getTimestamp()
        if stamp == self._last:
            return None
        self._last = stamp
        # The program's own slowing down, times the slider of the pendant.
        scaling = receive.getSpeedScaling() * receive.getTargetSpeedFraction()
        return Reading(receive.getActualQ(), receive.getActualQd(), receive.getActualTCPForce()[:3], scaling)

    def send(self, velocity: list[float]) -> None:
        """Command joint velocities (6,) [rad/s]."""
        if not self._control.speedJ(velocity, ACCELERATION, 0.0):
            raise DeviceLostError(self._why())

    def brake(self) -> None:
        """Brake all joints."""
        if not self._control.speedStop(BRAKE):
            raise DeviceLostError(self._why())

    def keep_alive(self) -> None:
        """Reset the watchdog of the program on the robot."""
        if not self._control.kickWatchdog():
            raise DeviceLostError(self._why())

    def close(self) -> None:
        """Brake and end the program on the robot."""
        if self._receive.isConnected() and self._control.isConnected():
            self._control.speedStop(BRAKE)
            self._control.stopScript()
        self._control.disconnect()
        self._receive.disconnect()

    def _why(self) -> str:
        until = time.monotonic() + TOLD
        while time.monotonic() < until:
            if self._receive.isEmergencyStopped():
                return "emergency stop"
            if self._receive.isProtectiveStopped():
                return "protective stop"
            time.sleep(0.002)
        return "the program on the robot has ended, or takes no commands"


driver = UrDriver
"""Entry point of the driver's process."""
