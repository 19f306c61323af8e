"""ROS 2 messages of joints, velocities and forces: definitions and encoding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike

from rehab_opt.loop.cdr import Cdr

__all__ = ["JOINT_STATE", "WRENCH", "MessageType", "floats", "joint_state", "wrench"]


class MessageType(NamedTuple):
    """Name and definition of a message type, including nested messages."""

    name: str
    definition: str


def _with(name: str, own: str, **within: str) -> MessageType:
    parts = [own, *(f"MSG: {each.replace('__', '/')}\n{text}" for each, text in within.items())]
    return MessageType(name, ("\n" + "=" * 80 + "\n").join(parts) + "\n")


_STAMPED = {
    "std_msgs__Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces__Time": "int32 sec\nuint32 nanosec",
}
JOINT_STATE = _with(
    "sensor_msgs/msg/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
    **_STAMPED,
)
WRENCH = _with(
    "geometry_msgs/msg/WrenchStamped",
    "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    geometry_msgs__Wrench="geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    geometry_msgs__Vector3="float64 x\nfloat64 y\nfloat64 z",
    **_STAMPED,
)


def joint_state(
    nanoseconds: int, names: Sequence[str], position: ArrayLike, velocity: ArrayLike = (), effort: ArrayLike = ()
) -> bytes:
    """Message of joint positions [rad, m], velocities [rad/s, m/s] and efforts [N m, N], with a time since 1970."""
    message = _header(nanoseconds, "").texts(names)
    return message.numbers(position).numbers(velocity).numbers(effort).done()


def wrench(nanoseconds: int, frame: str, force: Sequence[float]) -> bytes:
    """Message of a force (2,) or (3,) [N] in a frame, with zero torque; `nanoseconds` is the time since 1970."""
    message = _header(nanoseconds, frame)
    for each in (*force, 0.0, 0.0, 0.0, 0.0)[:6]:
        message.number("d", each)
    return message.done()


def floats(values: ArrayLike) -> bytes:
    """`std_msgs/Float64MultiArray` message of these numbers, as ros2_control's velocity controllers expect it."""
    return Cdr().number("I", 0).number("I", 0).numbers(values).done()


def _header(nanoseconds: int, frame: str) -> Cdr:
    return Cdr().number("i", nanoseconds // 10**9).number("I", nanoseconds % 10**9).text(frame)
