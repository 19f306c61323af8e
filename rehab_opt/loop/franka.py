"""Franka's arms, through franky."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any, TypeVar

from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.remote import Reading, RemoteDevice

__all__ = ["FrankaDriver", "connect_franka", "driver"]

T = TypeVar("T")

JOINTS = 7
ACCELERATION, JERK = 9.99, 2400.0
"""[rad/s^2, rad/s^3] A Research 3 stops above 10 and 5000. franky exceeds the jerk limit by a factor of 1.41 when it
replans during a ramp, and twice that with a lost cycle."""
UNFILTERED = 1000.0
"""[Hz] Cut-off at which libfranka's filter is off; the filter would add 1.6 ms of lag."""
WATCHDOG = 0.1
"""[s]"""


def connect_franka(
    host: str, *, rate_hz: float = 1000.0, watchdog: float = WATCHDOG, fifo: int | None = None
) -> RemoteDevice:
    """Connect to a robot with active FCI, as a `Device` with joint velocity commands.

    franky runs in its own process. Its C++ loop at 1 kHz moves the joints to each velocity within the robot's
    acceleration and jerk limits, so a step becomes a ramp with a few milliseconds of lag. Each velocity is valid for
    half of `watchdog`; then the robot brakes. If that process is killed, the robot brakes within 20 ms. A reflex of the
    robot ends the connection, with the robot's message as the reason.

    Parameters
    ----------
    host : address of the robot's controller. rate_hz : of the loop.
    watchdog : [s] without a state after which the robot counts as lost.
    fifo : priority of that process, see `Loop`. The robot expects answers within 1 ms.

    Raises
    ------
    ConfigurationError : franky is not installed (extra `franka`). DeviceLostError : no connection, or the robot has
        stopped before, which must be checked and cleared by hand.
    """
    if find_spec("franky") is None:
        raise ConfigurationError("host", host, "franky, which is not installed: pip install 'rehab_opt[franka]'")
    return RemoteDevice(
        "franka",
        {"host": host, "meant_for": watchdog / 2},
        joints=JOINTS,
        dt=1 / rate_hz,
        name=f"Franka at {host}",
        watchdog=watchdog,
        fifo=fifo,
    )


class FrankaDriver:
    """A `Driver` for Franka; raises `DeviceLostError` if the robot does not answer or has stopped.

    Parameters
    ----------
    host : address. meant_for : [s] for which a velocity is valid without a new one.
    """

    def __init__(self, host: str, meant_for: float) -> None:
        franky = self._franky = import_module("franky")
        # Without a kernel that keeps time libfranka would refuse; the robot counts what comes late, and stops at 20.
        self._robot: Any = self._told(lambda: franky.Robot(host, realtime_config=franky.RealtimeConfig.Ignore))
        if self._robot.has_errors:
            raise DeviceLostError(f"it has stopped before: {self._robot.state.current_errors}")
        for limit, largest in (
            (self._robot.joint_acceleration_limit, ACCELERATION),
            (self._robot.joint_jerk_limit, JERK),
        ):
            limit.set([min(each, largest) for each in limit.get()])
        self._rest = franky.JointVelocityWaypoint([0.0] * JOINTS, hold_target_duration=franky.Duration(1))
        self._meant_for = franky.Duration(round(1e3 * meant_for))
        self._last = -1

    def read(self) -> Reading | None:
        """The newest state, or None if there is no new one."""
        robot = self._robot
        self._told(robot.poll_motion)
        state = self._told(lambda: robot.state)
        now = state.time.to_msec()
        if now == self._last:
            return None
        self._last = now
        return Reading(state.q, state.dq, state.O_F_ext_hat_K[:3])

    def send(self, velocity: list[float]) -> None:
        """Command joint velocities (7,) [rad/s] for `meant_for`, then rest."""
        first = self._franky.JointVelocityWaypoint(velocity, hold_target_duration=self._meant_for)
        self._move(self._franky.JointVelocityWaypointMotion([first, self._rest]))

    def brake(self) -> None:
        """Brake all joints; franky's own stop would exceed the limits of a Research 3."""
        self._move(self._franky.JointVelocityWaypointMotion([self._rest]))

    def keep_alive(self) -> None:
        """Do nothing: without a motion the robot holds its position."""

    def close(self) -> None:
        """Brake."""
        robot = self._robot
        if robot.is_in_control:
            self.brake()
            self._told(lambda: robot.join_motion(1.0))

    def _move(self, motion: Any) -> None:
        move = self._robot.move  # its rate is limited, too, for the cycles that this machine misses
        self._told(lambda: move(motion, asynchronous=True, limit_rate=True, cutoff_frequency=UNFILTERED))

    def _told(self, ask: Callable[[], T]) -> T:
        """The robot's answer; raises `DeviceLostError` with the reason if it refuses or is gone."""
        try:
            return ask()
        except (self._franky.Exception, RuntimeError) as refused:
            raise DeviceLostError(" ".join(str(refused).split())) from refused


driver = FrankaDriver
"""Entry point of the driver's process."""
