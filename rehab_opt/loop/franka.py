"""Franka's arms, by franky."""

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
"""[rad/s^2, rad/s^3] A Research 3 stops above 10 and 5000; what franky planned anew amid a ramp reached 1.41 times the
jerk that it was given, and a cycle that is lost amid one twice that."""
UNFILTERED = 1000.0
"""[Hz] from which on libfranka does not filter what it is sent: the filter would be late by another 1.6 ms."""
WATCHDOG = 0.1
"""[s]"""


def connect_franka(
    host: str, *, rate_hz: float = 1000.0, watchdog: float = WATCHDOG, fifo: int | None = None
) -> RemoteDevice:
    """The robot at an address, its FCI active, as a `Device` of joint velocities.

    franky runs in a process of its own. Its loop of 1 kHz, in C++, leads the joints to each velocity within the
    robot's acceleration and jerk: what steps arrives as a ramp, a few milliseconds late. Each velocity is meant for
    half of `watchdog` and followed by rest: without commands the robot brakes; where that process is killed, after
    20 ms. A reflex ends it, with the robot's own words for the reason.

    Parameters
    ----------
    host : address of the robot's controller. rate_hz : of the loop.
    watchdog : [s] without a state after which the robot counts as lost here.
    fifo : priority of that process, see `Loop`. The robot's answers are due within a millisecond.

    Raises
    ------
    ConfigurationError : franky is not installed (extra `franka`). DeviceLostError : the robot cannot be connected, or
        has stopped before; that is to be looked at and cleared by hand.
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
    """A `Driver`. Raises a DeviceLostError where the robot does not answer, or has stopped.

    Parameters
    ----------
    host : address. meant_for : [s] for which a velocity is held where no other comes.
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
        """A state, if a new one has come."""
        robot = self._robot
        self._told(robot.poll_motion)
        state = self._told(lambda: robot.state)
        now = state.time.to_msec()
        if now == self._last:
            return None
        self._last = now
        return Reading(state.q, state.dq, state.O_F_ext_hat_K[:3])

    def send(self, velocity: list[float]) -> None:
        """Joint velocities (7,) [rad/s], for `meant_for`, then rest."""
        first = self._franky.JointVelocityWaypoint(velocity, hold_target_duration=self._meant_for)
        self._move(self._franky.JointVelocityWaypointMotion([first, self._rest]))

    def brake(self) -> None:
        """All joints to rest; franky's own stop knows no limits but its own, which are beyond a Research 3's."""
        self._move(self._franky.JointVelocityWaypointMotion([self._rest]))

    def keep_alive(self) -> None:
        """Nothing: without a motion the robot holds by itself."""

    def close(self) -> None:
        """To rest."""
        robot = self._robot
        if robot.is_in_control:
            self.brake()
            self._told(lambda: robot.join_motion(1.0))

    def _move(self, motion: Any) -> None:
        move = self._robot.move  # its rate is limited, too, for the cycles that this machine misses
        self._told(lambda: move(motion, asynchronous=True, limit_rate=True, cutoff_frequency=UNFILTERED))

    def _told(self, ask: Callable[[], T]) -> T:
        """What is answered; where the robot refuses, or is gone, why."""
        try:
            return ask()
        except (self._franky.Exception, RuntimeError) as refused:
            raise DeviceLostError(" ".join(str(refused).split())) from refused


driver = FrankaDriver
"""For the driver's process."""
