"""The oracle's person: Table I's arm in plain numpy, and whether some posture of its range has its hand at a pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["NAMES", "hand", "reaches"]

Array = NDArray[np.float64]

NAMES = (
    "scapular_retraction", "glenohumeral_rotation", "shoulder_adduction", "humeral_flexion", "forearm_extension",
    "wrist_flexion", "wrist_deviation", "wrist_supination",
)  # fmt: skip
LENGTHS = (0.130, 0.290, 0.300, 0.070)
QUARTERS = (0, -1, -1, 0, 0, 1, -1, 0)
"""Quarter turns about x of Table I's eight rows."""
STARTS, ROUNDS = 20, 60
NEAR, TURNED = 1e-3, math.radians(1.0)
"""[m, rad] within which a posture has a pose."""
TURN_LENGTH = 0.1
"""[m/rad]"""


def _frames(q: Array) -> Array:
    """(N, 9, 4, 4) from the left shoulder on: x to the right, y forward, z up; q (N, 8) as Table I counts."""
    l0, l1, l2, l3 = LENGTHS
    found = np.empty((len(q), 9, 4, 4))
    found[:, 0] = np.eye(4)
    for i, a in enumerate((l0, 0.0, 0.0, l1, l2, 0.0, 0.0, 0.0)):
        c, s = np.cos(q[:, i]), np.sin(q[:, i])
        ca, sa = (0.0, float(QUARTERS[i])) if QUARTERS[i] else (1.0, 0.0)
        row = np.zeros((len(q), 4, 4))
        row[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
        row[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
        row[:, 2, 1:], row[:, 3, 3] = (sa, ca, l3 if i == 7 else 0.0), 1.0
        found[:, i + 1] = found[:, i] @ row
    return found


def hand(q: Array) -> Array:
    """(N, 4, 4) of the hand: x along the handle, z to the fingers."""
    return np.asarray(_frames(q)[:, 8])


def reaches(poses: Array, lower: Array, upper: Array, *, seed: int = 0) -> NDArray[np.bool_]:
    """(N,) whether the hand gets to poses (N, 4, 4) within limits (8,) [rad], from 20 postures at random."""
    count, rng = len(poses), np.random.default_rng(seed)
    q = rng.uniform(lower, upper, (count * STARTS, 8))
    target = np.repeat(poses, STARTS, axis=0)
    best = np.full(len(q), math.inf)
    damping = np.full(len(q), 1e-2)
    kept = q.copy()
    for _ in range(ROUNDS):
        error, jacobian = _error(q, target)
        size = np.linalg.norm(error, axis=1)
        better = size < best
        best, kept = np.where(better, size, best), np.where(better[:, None], q, kept)
        damping = np.clip(np.where(better, damping / 3, damping * 4), 1e-9, 10.0)
        if not better.all():
            error, jacobian = _error(kept, target)
        # What a limit is in the way of takes no part in the step.
        step = _step(jacobian, error, damping, np.ones_like(kept, dtype=bool))
        free = ~(((kept <= lower) & (step < 0)) | ((kept >= upper) & (step > 0)))
        step = _step(jacobian, error, damping, free)
        q = np.clip(kept + step, lower, upper)
    error, _ = _error(kept, target)
    found = (np.linalg.norm(error[:, :3], axis=1) < NEAR) & (
        np.linalg.norm(error[:, 3:], axis=1) < TURN_LENGTH * TURNED
    )
    return np.asarray(found.reshape(count, STARTS).any(axis=1))


def _step(jacobian: Array, error: Array, damping: Array, free: NDArray[np.bool_]) -> Array:
    part = jacobian * free[:, None, :]
    square = part @ part.transpose(0, 2, 1) + damping[:, None, None] * 0.01 * np.eye(6)
    return np.asarray(np.einsum("nij,ni->nj", part, np.linalg.solve(square, error[:, :, None])[:, :, 0]))


def _error(q: Array, target: Array) -> tuple[Array, Array]:
    """(N, 6) [m] place and turn (by `TURN_LENGTH`) that are missing, and the hand's Jacobian (N, 6, 8)."""
    frames = _frames(q)
    here = frames[:, 8]
    turn = target[:, :3, :3] @ here[:, :3, :3].transpose(0, 2, 1)
    skew = (
        np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1) / 2
    )
    sine = np.linalg.norm(skew, axis=1)
    angle = np.arctan2(sine, (np.trace(turn, axis1=1, axis2=2) - 1) / 2)
    skew = skew * (angle / np.maximum(sine, 1e-12))[:, None]
    axes = frames[:, :8, :3, 2]
    arms = here[:, None, :3, 3] - frames[:, :8, :3, 3]
    jacobian = np.concatenate([np.cross(axes, arms), TURN_LENGTH * axes], axis=2).transpose(0, 2, 1)
    return np.concatenate([target[:, :3, 3] - here[:, :3, 3], TURN_LENGTH * skew], axis=1), jacobian
