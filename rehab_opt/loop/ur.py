"""Driver of Universal Robots' arms, through ur_rtde."""

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
"""Acceleration [rad/s^2] of speedj: its largest value, since the controllers limit accelerations themselves."""
BRAKE = 10.0
"""Deceleration [rad/s^2] of a stop."""
TOLD = 0.05
"""Longest time [s] until the robot's packages report why the robot refused a command."""
WATCHDOG = 0.1
"""Default time [s] without a package after which the robot counts as lost."""
RECIPE = [
    "timestamp", "actual_q", "actual_qd", "actual_TCP_force", "safety_status_bits", "speed_scaling",
    "target_speed_fraction",
]  # fmt: skip
"""Fields that the robot sends."""


def connect_ur(
    host: str, *, rate_hz: float = 500.0, watchdog: float = WATCHDOG, fifo: int | None = None
) -> RemoteDevice:
    """Connect to a UR arm in remote control, as a `Device` with joint velocity commands (`speedj`).

    ur_rtde runs in a process of its own. ur_rtde starts a program on the robot that stops the robot if no data arrive.

    Parameters
    ----------
    host : address of the robot's controller. rate_hz : rate of the loop [Hz]; the robot runs at 500 Hz, a CB3 at
        125 Hz.
    watchdog : time [s] without a package after which the robot stops and counts as lost.
    fifo : SCHED_FIFO priority of ur_rtde's process, as for `Loop`; on a busy machine set it like the loop's.

    Raises
    ------
    ConfigurationError : ur_rtde is not installed (extra `ur`). DeviceLostError : there is no connection to the robot.
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
    """`Driver` of a UR arm; raises DeviceLostError if the robot does not answer or is stopped."""

    def __init__(self, host: str, watchdog: float) -> None:
        try:
            self._receive: Any = import_module("rtde_receive").RTDEReceiveInterface(host, -1.0, RECIPE)
            self._control: Any = import_module("rtde_control").RTDEControlInterface(host)
            self._control.setWatchdog(1 / watchdog)
        except RuntimeError as refused:  # a C++ std::exception of ur_rtde
            raise DeviceLostError(str(refused)) from refused
        self._last = -1.0

    def read(self) -> Reading | None:
        """State in the newest package; None if there is no new package."""
        receive = self._receive
        if not receive.isConnected():
            raise DeviceLostError("the connection is closed")
        stamp = receive.getTimestamp()
        if stamp == self._last:
            return None
        self._last = stamp
        # The product of the robot's own speed scaling and of the speed slider on its pendant.
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
        """Brake to rest and end the program on the robot."""
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
"""Driver class that the driver's process loads."""
