"""Driver of Franka's arms, through franky."""

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
"""Acceleration and jerk limits [rad/s^2, rad/s^3]. A Research 3 stops above 10 and 5000. The jerk needs a margin:
franky exceeds its jerk limit by a factor of 1.41 when it replans during a ramp, and by more if a cycle is lost."""
UNFILTERED = 1000.0
"""Cut-off [Hz] that turns libfranka's filter off; the filter would add 1.6 ms of lag."""
WATCHDOG = 0.1
"""Default time [s] without a state after which the robot counts as lost."""


def connect_franka(
    host: str, *, rate_hz: float = 1000.0, watchdog: float = WATCHDOG, fifo: int | None = None
) -> RemoteDevice:
    """Connect to a Franka arm with active FCI, as a `Device` with joint velocity commands.

    franky runs in a process of its own. franky's C++ loop at 1 kHz tracks each commanded velocity within the robot's
    acceleration and jerk limits. A velocity step thus becomes a ramp with a few milliseconds of lag. If no new command
    arrives within half of `watchdog`, the robot brakes. If franky's process is killed, the robot brakes within 20 ms.
    If the robot stops with a reflex, the connection ends with the robot's message as the reason.

    Parameters
    ----------
    host : address of the robot's controller. rate_hz : rate of the loop [Hz].
    watchdog : time [s] without a state after which the robot counts as lost.
    fifo : SCHED_FIFO priority of franky's process, as for `Loop`. The robot expects answers within 1 ms.

    Raises
    ------
    ConfigurationError : franky is not installed (extra `franka`). DeviceLostError : there is no connection, or the
        robot reports an earlier error, which a person must check and clear.
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
    """`Driver` of a Franka arm; raises `DeviceLostError` if the robot does not answer or has stopped.

    Parameters
    ----------
    host : address of the robot's controller. meant_for : time [s] for which a commanded velocity is valid.
    """

    def __init__(self, host: str, meant_for: float) -> None:
        franky = self._franky = import_module("franky")
        # `Ignore` also accepts kernels without PREEMPT_RT; the robot counts late answers and stops at 20.
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
        """The newest state of the robot; None if there is no new one since the last call."""
        robot = self._robot
        self._told(robot.poll_motion)
        state = self._told(lambda: robot.state)
        now = state.time.to_msec()
        if now == self._last:
            return None
        self._last = now
        return Reading(state.q, state.dq, state.O_F_ext_hat_K[:3])

    def send(self, velocity: list[float]) -> None:
        """Command joint velocities (7,) [rad/s]; if no command follows within `meant_for` [s], the robot brakes."""
        first = self._franky.JointVelocityWaypoint(velocity, hold_target_duration=self._meant_for)
        self._move(self._franky.JointVelocityWaypointMotion([first, self._rest]))

    def brake(self) -> None:
        """Brake all joints to rest; franky's own stop would exceed the limits of a Research 3."""
        self._move(self._franky.JointVelocityWaypointMotion([self._rest]))

    def keep_alive(self) -> None:
        """Do nothing: without a motion the robot holds its position."""

    def close(self) -> None:
        """Brake to rest."""
        robot = self._robot
        if robot.is_in_control:
            self.brake()
            self._told(lambda: robot.join_motion(1.0))

    def _move(self, motion: Any) -> None:
        move = self._robot.move  # `limit_rate` prevents jumps if this machine misses cycles
        self._told(lambda: move(motion, asynchronous=True, limit_rate=True, cutoff_frequency=UNFILTERED))

    def _told(self, ask: Callable[[], T]) -> T:
        """The robot's answer; raises `DeviceLostError` with the reason if the robot refuses or is lost."""
        try:
            return ask()
        except (self._franky.Exception, RuntimeError) as refused:
            raise DeviceLostError(" ".join(str(refused).split())) from refused


driver = FrankaDriver
"""Driver class that the driver's process loads."""
