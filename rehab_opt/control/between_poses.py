"""Distances and rotations between two poses (4, 4).

Functions for C code take a pose as a column of its first 12 entries, row by row; the last row is constant.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.rigid import is_rigid, rotation_vector
from rehab_opt.optim.certificate import clipped
from rehab_opt.symbolic import Evaluator

__all__ = [
    "angle_of",
    "calm_way",
    "distance_of",
    "moving_tool_function",
    "part_way",
    "rigid_function",
    "turn_between",
    "turned",
]

Array = NDArray[np.float64]

NO_TURN = 1e-300
"""[rad] Lower bound of an angle in a denominator, so that 0/0 does not occur."""

_numbers = Evaluator()


def turn_between(a: Array, b: Array) -> Array:
    """Rotation vector (3,) [rad], in the base frame, from the axes of pose a to those of pose b."""
    return _numbers.of(_turn, a[:3, :3], b[:3, :3])


def turned(rotation: Array, vector: Array) -> Array:
    """Rotation matrix `rotation` (3, 3), rotated further by the rotation vector `vector` [rad] in the base frame."""
    return _numbers.of(_turned, rotation, vector)


# ------------------------------------------------------------------------------------------------- as functions
def rigid_function() -> ca.Function:
    """CasADi function of a pose (16 entries) that gives 1 if the pose is rigid, see `is_rigid`."""
    pose = ca.SX.sym("pose", 16)
    return ca.Function("rigid", [pose], [is_rigid(ca.reshape(pose, 4, 4).T)], {"cse": True})


def moving_tool_function(chain: SerialChain) -> ca.Function:
    """CasADi function from joint positions and velocities (n,) to the tool's pose (16 entries) and twist (6,)."""
    q, velocity = ca.SX.sym("q", chain.n), ca.SX.sym("velocity", chain.n)
    pose, twist = chain.pose_expression(q), chain.jacobian_expression(q) @ velocity
    return ca.Function("moving_tool", [q, velocity], [ca.densify(ca.vec(pose.T)), ca.densify(twist)], {"cse": True})


# -------------------------------------------------------------------------------------------------- expressions
def distance_of(a: ca.SX, b: ca.SX) -> ca.SX:
    """Distance [m] between the origins of two poses, which are columns of at least 12 entries."""
    return ca.norm_2(a[[3, 7, 11]] - b[[3, 7, 11]])


def angle_of(a: ca.SX, b: ca.SX) -> ca.SX:
    """Angle [rad], accurate to 1e-7, between two poses, which are columns of at least 12 entries."""
    trace = ca.SX(0)
    for i in (0, 1, 2, 4, 5, 6, 8, 9, 10):
        trace += a[i] * b[i]
    return ca.acos(clipped(0.5 * (trace - 1), -1, 1))


def part_way(a: ca.SX, b: ca.SX, fraction: ca.SX) -> ca.SX:
    """Rotation matrix (9,), row by row, after a `fraction` of the rotation from pose a (12,) to pose b (12,)."""
    one, other = (_by_rows(pose)[:3, :3] for pose in (a, b))
    return ca.vec(_turned(one, fraction * _turn(one, other)).T)


def calm_way(a: ca.SX, b: ca.SX, least: ca.SX, *, linear_speed: float, angular_speed: float) -> tuple[ca.SX, ca.SX]:
    """Duration [s] of a motion between poses (12,), at least `least`, and its twist (6,) within both speed limits."""
    one, other = _by_rows(a), _by_rows(b)
    shift, turn = other[:3, 3] - one[:3, 3], _turn(one[:3, :3], other[:3, :3])
    seconds = ca.fmax(ca.fmax(ca.norm_2(shift) / linear_speed, ca.norm_2(turn) / angular_speed), least)
    return seconds, ca.vertcat(shift, turn) / seconds


def _by_rows(entries: ca.SX) -> ca.SX:
    return ca.reshape(entries, 4, 3).T


def _turn(a: ca.SX, b: ca.SX) -> ca.SX:
    return rotation_vector(b @ a.T)


def _turned(rotation: ca.SX, vector: ca.SX) -> ca.SX:
    angle = ca.norm_2(vector)
    x, y, z = ca.vertsplit(vector / ca.fmax(angle, NO_TURN))
    k = ca.blockcat([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (ca.SX.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * (k @ k)) @ rotation
