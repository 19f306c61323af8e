"""Universal Robots' arms, by ur_rtde."""

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
"""[rad/s^2] The largest that speedj takes: the controller's own bounds are below it, and a lower one would be late."""
BRAKE = 10.0
"""[rad/s^2]"""
TOLD = 0.05
"""[s] within which the packages report why a command was not taken."""
WATCHDOG = 0.1
"""[s]"""


def connect_ur(
    host: str, *, rate_hz: float = 500.0, watchdog: float = WATCHDOG, fifo: int | None = None
) -> RemoteDevice:
    """The robot at an address, in remote control, as a `Device` of joint velocities (`speedj`).

    ur_rtde runs in a process of its own. It starts a program on the robot that stops it where nothing is received.

    Parameters
    ----------
    host : address of the robot's controller. rate_hz : of the loop; the robot takes 500 a second, a CB3 125.
    watchdog : [s] without a package after which the robot stops, and after which it counts as lost here.
    fifo : priority of that process, see `Loop`: where other programs run, too, it has to be in time as the loop has.

    Raises
    ------
    ConfigurationError : ur_rtde is not installed (extra `ur`). DeviceLostError : the robot cannot be connected.
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
    """A `Driver`. Raises a DeviceLostError where the robot does not answer, or is stopped."""

    def __init__(self, host: str, watchdog: float) -> None:
        try:
            self._receive: Any = import_module("rtde_receive").RTDEReceiveInterface(
                host, -1.0, ["timestamp", "actual_q", "actual_qd", "actual_TCP_force", "safety_status_bits"]
            )
            self._control: Any = import_module("rtde_control").RTDEControlInterface(host)
            self._control.setWatchdog(1 / watchdog)
        except RuntimeError as refused:  # of C++: what std::exception is in Python
            raise DeviceLostError(str(refused)) from refused
        self._last = -1.0

    def read(self) -> Reading | None:
        """A package, if one has come."""
        receive = self._receive
        if not receive.isConnected():
            raise DeviceLostError("the connection is closed")
        stamp = receive.getTimestamp()
        if stamp == self._last:
            return None
        self._last = stamp
        return Reading(receive.getActualQ(), receive.getActualQd(), receive.getActualTCPForce()[:3])

    def send(self, velocity: list[float]) -> None:
        """Joint velocities (6,) [rad/s]."""
        if not self._control.speedJ(velocity, ACCELERATION, 0.0):
            raise DeviceLostError(self._why())

    def brake(self) -> None:
        """All joints to rest."""
        if not self._control.speedStop(BRAKE):
            raise DeviceLostError(self._why())

    def keep_alive(self) -> None:
        """Kick the watchdog of the program on the robot."""
        if not self._control.kickWatchdog():
            raise DeviceLostError(self._why())

    def close(self) -> None:
        """To rest; the program on the robot ends."""
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
"""For the driver's process."""
