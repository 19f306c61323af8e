"""Obstacles beside a robot: fixed half-spaces and boxes, moving capsules, and a person's arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.kinematics.real_array import real_array
from rehab_opt.kinematics.rigid import rigid

__all__ = ["ARM_RADII", "MOVING", "Box", "KeepOut", "MovingCapsule", "arm_capsules", "moving_numbers"]

Array = NDArray[np.float64]

MOVING = 14
"""Number of values of a moving capsule: its two ends, their velocities, its radius, and a flag (0: no capsule).

Any other flag, also NaN, means that there is a capsule, and a negative radius counts as zero. So a bad number never
removes an obstacle.
"""
SIGHT = 100.0
"""[m] Largest accepted coordinate of a moving capsule, and of a person's shoulder."""
ENDS = (1, 4, 5, 8)
"""Frames of `human_arm` at shoulder, elbow, wrist and fingers."""
ARM_RADII = (0.06, 0.05, 0.045)
"""[m] Assumption: upper arm, forearm and hand of an adult with clothes."""


class KeepOut(NamedTuple):
    """A half-space that the arm must not enter: its boundary plane's normal points to the allowed side."""

    normal: tuple[float, float, float]
    """Unit normal in the base frame, towards the allowed side."""
    offset: float
    """[m] The points x of the boundary plane satisfy normal . x = offset."""

    @classmethod
    def through(cls, point: ArrayLike, normal: ArrayLike) -> KeepOut:
        """The plane through `point` (3,) [m]; `normal` (3,), of any length, points to the allowed side.

        Raises
        ------
        ConfigurationError : the numbers do not define a plane.
        """
        try:
            p, n = (np.array(value, dtype=np.float64) for value in (point, normal))
        except (TypeError, ValueError, OverflowError) as problem:
            raise ConfigurationError("point, normal", (point, normal), "three numbers each") from problem
        if p.shape != (3,) or n.shape != (3,) or not np.all(np.isfinite([p, n])) or not np.linalg.norm(n) > 1e-9:
            raise ConfigurationError("point, normal", (point, normal), "three finite numbers each, a normal above zero")
        x, y, z = (float(each) for each in n / np.linalg.norm(n))
        return cls((x, y, z), float(p @ (x, y, z)))


class Box(NamedTuple):
    """A box that does not move."""

    name: str
    centre: tuple[float, float, float]
    """(3,) position of the centre in the base frame [m]."""
    size: tuple[float, float, float]
    """(3,) lengths of the box along its axes [m]."""
    turn: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """(3, 3) rotation from the axes of the box to those of the base frame."""

    @classmethod
    def at(cls, name: str, pose: ArrayLike, size: ArrayLike) -> Box:
        """The box at a pose (4, 4) in the base frame.

        Raises
        ------
        ConfigurationError : a pose that is not rigid, or sizes (3,) that are not above zero.
        """
        placed, sizes = rigid("pose", pose), per_joint("size", size, 3, finite=True)
        if not np.all(sizes > 0):
            raise ConfigurationError("size", size, "three lengths above zero [m]")
        x, y, z = placed[:3, 3].tolist()
        a, b, c = sizes.tolist()
        return cls(name, (x, y, z), (a, b, c), tuple(tuple(row) for row in placed[:3, :3].tolist()))


class MovingCapsule(NamedTuple):
    """A capsule that moves, in the base frame; the caller gives it in each tick."""

    start: ArrayLike
    """(3,) [m]"""
    end: ArrayLike
    """(3,) [m]; equal to `start` for a sphere."""
    radius: float
    """[m]"""
    start_velocity: ArrayLike = (0.0, 0.0, 0.0)
    """(3,) [m/s]"""
    end_velocity: ArrayLike = (0.0, 0.0, 0.0)
    """(3,) [m/s]"""


def moving_numbers(obstacles: Sequence[MovingCapsule] | Array, count: int, argument: str = "obstacles") -> Array:
    """Array (count, 14) of moving capsules as inputs of a tick: see `MOVING`; unused rows are zero.

    Raises
    ------
    ConfigurationError : more than `count` capsules, or other objects. Numbers that are not finite raise no error: the
        tick then gives the fallback command.
    """
    if isinstance(obstacles, np.ndarray):
        if obstacles.shape == (count, MOVING):
            return obstacles
        raise ConfigurationError(argument, obstacles, f"an array of shape ({count}, {MOVING}), or MovingCapsules")
    if not isinstance(obstacles, (list, tuple)) or not len(obstacles) <= count:
        raise ConfigurationError(argument, obstacles, f"at most {count} MovingCapsules, as given at construction")
    numbers = np.zeros((count, MOVING))
    for i, each in enumerate(obstacles):
        if not isinstance(each, MovingCapsule):
            raise ConfigurationError(f"{argument}[{i}]", each, "a MovingCapsule")
        try:
            parts = [real_array(part) for part in (each.start, each.end, each.start_velocity, each.end_velocity)]
            numbers[i] = np.concatenate([*(part.reshape(3) for part in parts), [float(each.radius), 1.0]])
        except (TypeError, ValueError, OverflowError) as problem:
            raise ConfigurationError(f"{argument}[{i}]", each, "ends and velocities (3,), and a radius") from problem
    return numbers


def arm_capsules(
    arm: SerialChain,
    q: ArrayLike,
    velocity: ArrayLike = 0.0,
    *,
    placement: ArrayLike,
    radii: tuple[float, float, float] = ARM_RADII,
) -> tuple[MovingCapsule, MovingCapsule, MovingCapsule]:
    """Upper arm, forearm and hand of a person as obstacles of a tick; omit the hand that holds the robot.

    Parameters
    ----------
    arm : a `human_arm`. q : (8,) its posture [rad], measured or estimated. velocity : (8,) or scalar [rad/s].
    placement : (4, 4) pose of the arm's frame, whose origin is the shoulder, in the robot's base frame.
    radii : [m] of upper arm, forearm and hand; the defaults are assumptions.

    Raises
    ------
    ConfigurationError : a chain that is no `human_arm`, a wrong shape, a placement that is not rigid.
    """
    if not isinstance(arm, SerialChain) or arm.names != ARM_JOINTS:
        raise ConfigurationError("arm", arm, "a human_arm")
    placed = rigid("placement", placement)
    if np.abs(placed[:3, 3]).max() > SIGHT:
        raise ConfigurationError("placement", placed[:3, 3], f"coordinates of at most {SIGHT:g} m: is it in metres?")
    if not all(0 <= radius <= 1 for radius in radii):
        raise ConfigurationError("radii", radii, "0 to 1 m: are they in metres?")
    posture, rates = per_joint("q", q, arm.n), per_joint("velocity", velocity, arm.n)

    def arm_ends(q: ca.SX, velocity: ca.SX) -> ca.SX:
        frames = arm.frames_expression(q)
        ends = ca.vertcat(*(frames[i][:3, 3] for i in ENDS))
        return ca.vertcat(ends, ca.jtimes(ends, q, velocity))

    ends, speeds = arm._evaluator.of(arm_ends, posture, rates).reshape(2, len(ENDS), 3) @ placed[:3, :3].T
    ends = ends + placed[:3, 3]
    upper, fore, hand = (
        MovingCapsule(ends[i], ends[i + 1], radius, speeds[i], speeds[i + 1]) for i, radius in enumerate(radii)
    )
    return upper, fore, hand
