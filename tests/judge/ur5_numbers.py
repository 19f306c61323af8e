"""The UR5 in plain numpy, many states at once: vendor's lengths, product of its six rows, w by its closed form."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
TWIST = (1, 0, 0, 1, -1, 0)
"""Quarter turns about x of each row."""
LIMIT = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 2.0]) * math.pi
SHOULDER, ELBOW = 0.13585, 0.1197
"""[m] by which the upper arm lies beside the first row's origin, and the forearm back again: the vendor's drawing."""
READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])


def frames(q: Array, rows: Iterable[tuple[float, int, float]] = tuple(zip(A, TWIST, D, strict=True))) -> Array:
    """(N, n + 1, 4, 4) poses of base and of the frames of n rows at q (N, n): a [m], quarter turns about x, d [m]."""
    found = [np.tile(np.eye(4), (len(q), 1, 1))]
    for (a, quarters, d), angle in zip(rows, q.T, strict=True):
        c, s, row = np.cos(angle), np.sin(angle), np.zeros((len(q), 4, 4))
        ca, sa = (1.0, 0.0) if quarters == 0 else (0.0, float(quarters))
        row[:, 0] = np.column_stack([c, -s * ca, s * sa, a * c])
        row[:, 1] = np.column_stack([s, c * ca, -c * sa, a * s])
        row[:, 2, 1], row[:, 2, 2], row[:, 2, 3], row[:, 3, 3] = sa, ca, d, 1.0
        found.append(found[-1] @ row)
    return np.stack(found, axis=1)


def tool(q: Array) -> Array:
    """(N, 4, 4) poses of the flange."""
    return frames(q)[:, 6]


def hand_twist(q: Array, speed: Array) -> Array:
    """(N, 6) linear [m/s], then angular [rad/s] velocity of the flange at q, q' (N, 6)."""
    found = frames(q)
    axes, origins = found[:, :6, :3, 2], found[:, :6, :3, 3]
    arms = found[:, 6, None, :3, 3] - origins
    linear = np.einsum("nj,njx->nx", speed, np.cross(axes, arms))
    return np.concatenate([linear, np.einsum("nj,njx->nx", speed, axes)], axis=1)


def jacobian(q: Array) -> Array:
    """(N, 6, 6) of the flange."""
    found = frames(q)
    axes, arms = found[:, :6, :3, 2], found[:, 6, None, :3, 3] - found[:, :6, :3, 3]
    return np.concatenate([np.cross(axes, arms), axes], axis=2).transpose(0, 2, 1)


def turn_between(target: Array, here: Array) -> Array:
    """(N, 3) rotation vectors that lead from the rotations `here` (N, 3, 3) to `target`."""
    turn = target @ here.transpose(0, 2, 1)
    skew = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1)
    sine = 0.5 * np.linalg.norm(skew, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    return np.where(sine[:, None] > 1e-9, 0.5 * skew * (angle / np.maximum(sine, 1e-12))[:, None], 0.5 * skew)


def _fraction(q: Array) -> Array:
    reach = A[1] * np.cos(q[:, 1]) + A[2] * np.cos(q[:, 1] + q[:, 2]) + D[4] * np.sin(q[:, 1] + q[:, 2] + q[:, 3])
    return np.asarray(np.abs(A[1] * A[2] * np.sin(q[:, 2]) * np.sin(q[:, 4]) * reach))


def _largest() -> float:
    """Of the closed form: the wrist along the line from shoulder to wrist, s5 = 1; one angle is left."""
    elbow = np.linspace(0.0, math.pi, 2_000_001)
    reach = np.sqrt(A[1] ** 2 + A[2] ** 2 + 2 * A[1] * A[2] * np.cos(elbow)) + D[4]
    return float(np.max(A[1] * A[2] * np.sin(elbow) * reach))


LARGEST = _largest()
"""Largest w = |det J|."""


def manipulability(q: Array) -> Array:
    """(N,) w = |det J| over its largest."""
    return _fraction(q) / LARGEST


def links(q: Array) -> Array:
    """(N, 8, 3) [m] corners of the arm's polygon line: shoulder, upper arm, forearm beside it, wrists, flange."""
    found = frames(q)
    shoulder, turning = found[:, 1, :3, 3], found[:, 1, :3, 2]
    out = shoulder + SHOULDER * turning
    elbow = out + found[:, 2, :3, 3] - shoulder
    back = elbow - ELBOW * turning
    wrist = back + found[:, 3, :3, 3] - found[:, 2, :3, 3]
    return np.stack([shoulder, out, elbow, back, wrist, *(found[:, i, :3, 3] for i in (4, 5, 6))], axis=1)
