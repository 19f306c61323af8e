"""Robots in the messages of ROS 2, through zenoh: joint states come, joint velocities go."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.messages import floats
from rehab_opt.loop.remote import Reading, RemoteDevice

__all__ = ["Ros2Driver", "connect_ros2", "driver", "joints_of"]

WATCHDOG = 0.1
"""[s]"""


def connect_ros2(
    names: Sequence[str],
    *,
    rate_hz: float,
    locator: str = "tcp/127.0.0.1:7447",
    states: str = "joint_states",
    commands: str = "forward_velocity_controller/commands",
    watchdog: float = WATCHDOG,
    fifo: int | None = None,
) -> RemoteDevice:
    """A robot of ROS 2 as a `Device`: `sensor_msgs/JointState` in, `std_msgs/Float64MultiArray` out, as bytes of CDR.

    They go through zenoh as its bridge for ROS 2 (zenoh-bridge-ros2dds) hands them on, under the topics' names. The
    controller there needs a time-out of its own: without commands ros2_control's forward controllers hold the last
    velocity. Forces are not read: they are zero.

    Parameters
    ----------
    names : of the joints, in the order of the commands. rate_hz : of the loop.
    locator : where the bridge or router listens. states, commands : topics, without the first slash.
    watchdog : [s] without a joint state after which the robot counts as lost here; half of it without a command brakes.
    fifo : priority of the driver's process, see `Loop`.

    Raises
    ------
    ConfigurationError : zenoh is not installed (extra `ros2`), no names. DeviceLostError : no joint state comes.
    """
    if find_spec("zenoh") is None:
        raise ConfigurationError("locator", locator, "zenoh, which is not installed: pip install 'rehab_opt[ros2]'")
    joints = list(names)
    if not joints or len(set(joints)) < len(joints):
        raise ConfigurationError("names", joints, "names of joints, each once")
    options = {"names": joints, "locator": locator, "states": states, "commands": commands}
    return RemoteDevice(
        "ros2", options, joints=len(joints), dt=1 / rate_hz, name=f"{states} at {locator}", watchdog=watchdog, fifo=fifo
    )


class Ros2Driver:
    """A `Driver`. Raises a DeviceLostError where there is no connection, or a message that is no joint state."""

    def __init__(self, names: list[str], locator: str, states: str, commands: str) -> None:
        zenoh: Any = import_module("zenoh")
        config = zenoh.Config()
        for key, value in (("mode", "client"), ("connect/endpoints", [locator]), ("scouting/multicast/enabled", False)):
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as refused:
            raise DeviceLostError(str(refused).splitlines()[0]) from refused
        self._names, self._newest = names, b""
        self._subscriber = self._session.declare_subscriber(states, self._came)
        self._publisher = self._session.declare_publisher(commands)

    def _came(self, sample: Any) -> None:
        self._newest = sample.payload.to_bytes()  # of two between two looks, the later one counts

    def read(self) -> Reading | None:
        """The joint state that came last, if one has."""
        message, self._newest = self._newest, b""
        if not message:
            return None
        position, velocity = joints_of(message, self._names)
        return Reading(position, velocity, np.zeros(3))

    def send(self, velocity: list[float]) -> None:
        """Joint velocities [rad/s, m/s]."""
        self._publisher.put(floats(velocity))

    def brake(self) -> None:
        """Zeros: the controller of the robot knows how fast it may stop."""
        self.send([0.0] * len(self._names))

    def keep_alive(self) -> None:
        """Zeros again, for a controller with a time-out."""
        self.brake()

    def close(self) -> None:
        """To rest, and disconnect."""
        self.brake()
        self._session.close()


driver = Ros2Driver
"""For the driver's process."""


def joints_of(message: bytes, names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and velocities (n,) of these joints in a `sensor_msgs/JointState`; velocities it lacks are zero.

    Raises
    ------
    DeviceLostError : it is cut short, in another encoding, or lacks a joint.
    """
    try:
        told, position, velocity = _parts(message)
        order = [told.index(name) for name in names]
        speeds = velocity[order] if velocity.size else np.zeros(len(order))
        return position[order], speeds
    except (struct.error, ValueError, IndexError, UnicodeDecodeError) as wrong:
        raise DeviceLostError(f"a joint state that cannot be read, or without {', '.join(names)} ({wrong})") from wrong


def _parts(message: bytes) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    order = {b"\0\0": ">", b"\0\1": "<"}.get(message[:2])
    if order is None:
        raise ValueError(f"encoding {message[:2].hex()}")
    body, place = message[4:], 8  # behind seconds and nanoseconds

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

    text()  # the frame
    return [text() for _ in range(counted())], numbers(), numbers()
