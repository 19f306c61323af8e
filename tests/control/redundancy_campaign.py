"""What a hand does, and how far two segments are apart, worked out without the controller's arithmetic."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.mobile_arm import Capsule, MobileArm

Array = NDArray[np.float64]


def hand_twist(robot: MobileArm, q: Array, v: Array, rows: tuple[str, ...], frame: str) -> Array:
    """What the hand does in the given rows."""
    twist = robot.chain.jacobian(q) @ v
    roll = robot.chain.pose(q)[:3, 2] @ twist[3:]
    if frame == "chassis":
        cos, sin = math.cos(q[2]), math.sin(q[2])
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        twist = np.concatenate([turn @ twist[:3], turn @ twist[3:]])
    every = dict(zip(("x", "y", "z", "rx", "ry", "rz", "roll7"), [*twist, roll], strict=True))
    return np.array([every[row] for row in rows])


def segment_distance(begin: Array, end: Array, capsule: Capsule) -> float:
    """Between two segments: where the lines are nearest if that is on both, else from an end of one."""
    start, stop = np.asarray(capsule.start), np.asarray(capsule.end)
    one, two = end - begin, stop - start
    candidates = [_from_point(p, start, two) for p in (begin, end)] + [
        _from_point(p, begin, one) for p in (start, stop)
    ]
    system = np.stack([one, -two], axis=1)
    fraction, *_ = np.linalg.lstsq(system, start - begin, rcond=None)
    if np.all((fraction >= 0) & (fraction <= 1)):
        candidates.append(float(np.linalg.norm(begin + fraction[0] * one - start - fraction[1] * two)))
    return min(candidates)


def _from_point(point: Array, start: Array, along: Array) -> float:
    fraction = np.clip((point - start) @ along / (along @ along), 0, 1)
    return float(np.linalg.norm(point - start - fraction * along))
