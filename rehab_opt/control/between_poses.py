"""Distances and turns between two poses (4, 4), in plain Python where a tick waits for them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["angle_between", "distance_between", "turn_between", "turned"]

Array = NDArray[np.float64]


def distance_between(a: Array, b: Array) -> float:
    """[m] between the origins of two poses."""
    (_, _, _, ax), (_, _, _, ay), (_, _, _, az), _ = a.tolist()
    (_, _, _, bx), (_, _, _, by), (_, _, _, bz), _ = b.tolist()
    return math.hypot(ax - bx, ay - by, az - bz)


def angle_between(one: Array, other: Array) -> float:
    """[rad] between the axes of two poses, to 1e-7: from the trace of one's inverse times the other."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = one.tolist()
    (j, k, u, _), (m, n, o, _), (p, q, r, _), _ = other.tolist()
    trace = a * j + b * k + c * u + d * m + e * n + f * o + g * p + h * q + i * r
    return math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))


def turn_between(a: Array, b: Array) -> Array:
    """(3,) rotation vector [rad] in the base frame that turns pose a's axes into b's."""
    r = b[:3, :3] @ a[:3, :3].T
    skew = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(r)) - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        return np.asarray(skew * (angle / sine))
    if cosine > 0.0:
        return skew
    symmetric = 0.5 * (r + r.T) + np.eye(3)  # half a turn: twice the axis times itself
    column = symmetric[:, int(np.argmax(np.diag(symmetric)))]
    return np.asarray(math.pi * column / np.linalg.norm(column))


def turned(rotation: Array, vector: Array) -> Array:
    """`rotation` (3, 3) turned about the base frame's axes by a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return rotation
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray((np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k)) @ rotation)
