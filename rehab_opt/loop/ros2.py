"""Driver of robots with ROS 2, through zenoh: receives joint states and sends joint velocities."""

from __future__ import annotations

import json
import math
import struct
import time
from collections import deque
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.messages import floats
from rehab_opt.loop.remote import Reading, RemoteDevice

__all__ = ["Ros2Driver", "connect_ros2", "driver", "fraction_of", "joints_of"]

WATCHDOG = 0.1
"""Default time [s] without a joint state after which the robot counts as lost."""
HUNDRED_PERCENT = b"\0\1\0\0" + struct.pack("<d", 100.0)
UNHEARD, WAITING = 2.0, 1000
"""Longest wait [s] for the first states of all joints, and largest number of queued messages."""


def connect_ros2(
    names: Sequence[str],
    *,
    rate_hz: float,
    locator: str = "tcp/127.0.0.1:7447",
    states: str = "joint_states",
    commands: str = "forward_velocity_controller/commands",
    scaling: str = "speed_scaling_state_broadcaster/speed_scaling",
    watchdog: float = WATCHDOG,
    fifo: int | None = None,
) -> RemoteDevice:
    """Connect to a robot with ROS 2, as a `Device` with joint velocity commands.

    The driver receives `sensor_msgs/JointState` and sends `std_msgs/Float64MultiArray` messages through zenoh's bridge
    for ROS 2 (zenoh-bridge-ros2dds). The robot's controller needs a time-out of its own: without commands,
    ros2_control's forward controllers hold the last velocity. A message may lack some of the joints, and may have
    additional ones; a state is complete once each joint has a new value. The measured force is always zero.

    Parameters
    ----------
    names : names of the joints, in the order of the commands. rate_hz : rate of the loop [Hz].
    locator : address of the bridge or router. states, commands : names of the topics, without the first slash.
    scaling : topic of `std_msgs/Float64` with the robot's speed scaling [%], which the drivers of UR and Elite publish.
        Before the first message, the speed scaling counts as 100 %.
    watchdog : time [s] without a joint state after which the robot counts as lost. The driver brakes after half of this
        time without a command.
    fifo : SCHED_FIFO priority of the driver's process, as for `Loop`.

    Raises
    ------
    ConfigurationError : zenoh is not installed (extra `ros2`), or names are missing or repeated. DeviceLostError : no
        joint state arrives.
    """
    if find_spec("zenoh") is None:
        raise ConfigurationError("locator", locator, "zenoh, which is not installed: pip install 'rehab_opt[ros2]'")
    joints = list(names)
    if not joints or len(set(joints)) < len(joints):
        raise ConfigurationError("names", joints, "names of joints, each once")
    options = {"names": joints, "locator": locator, "states": states, "commands": commands, "scaling": scaling}
    return RemoteDevice(
        "ros2", options, joints=len(joints), dt=1 / rate_hz, name=f"{states} at {locator}", watchdog=watchdog, fifo=fifo
    )


class Ros2Driver:
    """`Driver` of a robot with ROS 2; raises DeviceLostError without a connection or for an invalid message."""

    def __init__(self, names: list[str], locator: str, states: str, commands: str, scaling: str) -> None:
        zenoh: Any = import_module("zenoh")
        config = zenoh.Config()
        for key, value in (("mode", "client"), ("connect/endpoints", [locator]), ("scouting/multicast/enabled", False)):
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as refused:
            raise DeviceLostError(str(refused).splitlines()[0]) from refused
        self._names, self._messages = names, deque[bytes](maxlen=WAITING)
        self._state = np.full((2, len(names)), math.nan)
        self._begun: float | None = time.monotonic()
        self._scaling = HUNDRED_PERCENT
        self._subscribers = [
            self._session.declare_subscriber(*each) for each in ((states, self._came), (scaling, self._scaled))
        ]
        self._publisher = self._session.declare_publisher(commands)

    def _came(self, sample: Any) -> None:
        self._messages.append(sample.payload.to_bytes())

    def _scaled(self, sample: Any) -> None:
        self._scaling = sample.payload.to_bytes()

    def read(self) -> Reading | None:
        """State of all joints; None until each joint has a new value since the last state."""
        came = None
        while self._messages:
            came = np.array(joints_of(self._messages.popleft(), self._names))
            self._state = np.where(np.isnan(came[:1]), self._state, came)
        missing = np.isnan(self._state[0])
        if not missing.any():
            (position, velocity), self._begun = self._state, None
            self._state = np.full_like(self._state, math.nan)
            return Reading(position, velocity, np.zeros(3), fraction_of(self._scaling))
        if came is not None and self._begun is not None and time.monotonic() - self._begun > UNHEARD:
            names = ", ".join(name for name, out in zip(self._names, missing, strict=True) if out)
            raise DeviceLostError(f"joint states come without a position of {names}")
        return None

    def send(self, velocity: list[float]) -> None:
        """Command joint velocities [rad/s, m/s]."""
        self._publisher.put(floats(velocity))

    def brake(self) -> None:
        """Command zero velocities; the robot's controller limits the deceleration."""
        self.send([0.0] * len(self._names))

    def keep_alive(self) -> None:
        """Command zero velocities again, for a robot's controller with a time-out."""
        self.brake()

    def close(self) -> None:
        """Brake and disconnect."""
        self.brake()
        self._session.close()


def fraction_of(message: bytes) -> float:
    """Fraction of the commanded speed, from a `std_msgs/Float64` message in percent.

    Raises
    ------
    DeviceLostError : the message is truncated or has another encoding, or its number is negative or not finite.
    """
    try:
        (percent,) = struct.unpack_from(_order(message) + "d", message, 4)
    except (struct.error, ValueError) as wrong:
        raise DeviceLostError(f"a speed scaling that cannot be read ({wrong})") from wrong
    if not 0 <= percent < math.inf:
        raise DeviceLostError(f"a speed scaling of {percent} %")
    return float(percent) / 100


driver = Ros2Driver
"""Driver class that the driver's process loads."""


def joints_of(message: bytes, names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and velocities (n,) of the named joints in a `sensor_msgs/JointState` message.

    Missing and NaN velocities are zero. If a joint has no position, its position and velocity are NaN.

    Raises
    ------
    DeviceLostError : the message is truncated, has another encoding, has different numbers of names and values, or
        has two positions of a joint.
    """
    try:
        told, position, velocity = _parts(message)
        velocity = np.where(np.isnan(velocity), 0.0, velocity) if velocity.size else np.zeros(position.size)
        found = np.full((2, len(names)), math.nan)
        for i, name in enumerate(names) if position.size else ():
            at = _place(name, told, position)
            if at is not None:
                found[:, i] = position[at], velocity[at]
    except (struct.error, ValueError, IndexError, UnicodeDecodeError) as wrong:
        raise DeviceLostError(f"a joint state that cannot be read ({wrong})") from wrong
    return found[0], found[1]


def _place(name: str, told: list[str], position: NDArray[np.float64]) -> int | None:
    places = [i for i, each in enumerate(told) if each == name]
    if len(set(position[places].tolist())) > 1:
        raise ValueError(f"{name} is at {' and at '.join(map(str, position[places]))}")
    return places[0] if places else None


def _order(message: bytes) -> str:
    """Byte order of a message, as a format character of `struct`."""
    order = {b"\0\0": ">", b"\0\1": "<"}.get(message[:2])
    if order is None:
        raise ValueError(f"encoding {message[:2].hex()}")
    return order


def _parts(message: bytes) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    order, body, place = _order(message), message[4:], 8  # skips seconds and nanoseconds

    def counted() -> int:
        nonlocal place
        place += -place % 4
        (count,) = struct.unpack_from(order + "I", body, place)
        place += 4
        return int(count)

    def text() -> str:
        nonlocal place
        size = counted()
        found = body[place : place + size]
        place += size
        return found[:-1].decode()

    def numbers() -> NDArray[np.float64]:
        nonlocal place
        count = counted()
        if not count:
            return np.zeros(0)
        place += -place % 8
        found = np.frombuffer(body, order + "f8", count, place).astype(np.float64)
        place += 8 * count
        return found

    text()  # skips the frame's name
    names, position, velocity = [text() for _ in range(counted())], numbers(), numbers()
    for array in (position, velocity):
        if array.size not in (0, len(names)):
            raise ValueError(f"{array.size} numbers of {len(names)} joints")
    return names, position, velocity
