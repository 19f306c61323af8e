"""Capsules on a robot's links, which move with the link frames, and fixed capsules beside the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import is_real

__all__ = ["Capsule", "CapsuleOnLink", "LinkCapsule", "checked_capsules"]


class Capsule(NamedTuple):
    """All points within `radius` [m] of the segment from `start` to `end` (3,) [m], in the base frame.

    For a chair the base frame is its chassis frame. Equal ends make a sphere.
    """

    name: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


class LinkCapsule(NamedTuple):
    """All points within `radius` [m] of the segment from `start` to `end` (3,), in a frame of a `SerialChain` [m]."""

    name: str
    frame: int
    """Number of the frame in `frames_expression`: 0 is the base frame, i the frame after row i, n + 1 the tool
    frame."""
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


class CapsuleOnLink(NamedTuple):
    """All points within `radius` [m] of the segment from `start` to `end` (3,) [m], in a link frame of a robot file."""

    link: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


def checked_capsules(capsules: object, frames: int) -> tuple[LinkCapsule, ...]:
    """The capsules; `ConfigurationError` if a number is not finite or a frame is not below `frames`."""
    if not isinstance(capsules, Sequence):
        raise ConfigurationError("capsules", capsules, "a list or tuple of LinkCapsule")
    checked = []
    for i, given in enumerate(capsules):
        try:
            name, frame, start, end, radius = given
            (ax, ay, az), (bx, by, bz) = (map(float, point) for point in (start, end))
            capsule = LinkCapsule(name, frame, (ax, ay, az), (bx, by, bz), float(radius))
            valid = isinstance(name, str) and type(frame) is int and 0 <= frame < frames and capsule.radius >= 0.0
            valid = valid and all(map(math.isfinite, (*capsule.start, *capsule.end, capsule.radius)))
        except (TypeError, ValueError, OverflowError):
            valid = False
        if isinstance(given, LinkCapsule) and not (is_real(given.radius) and 0.0 <= given.radius < math.inf):
            raise ConfigurationError(f"capsules[{i}].radius", given.radius, "0 m or more")
        if not valid:
            expected = f"LinkCapsule(name, frame from 0 to {frames - 1}, start (3,), end (3,), radius of 0 or more [m])"
            raise ConfigurationError(f"capsules[{i}]", given, expected)
        checked.append(capsule)
    return tuple(checked)
