"""The oracle's UR5: its eight closed-form postures for a pose, and their manipulability; nothing judged is imported."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

__all__ = ["branch_of", "flange", "manipulability", "postures"]

Array = NDArray[np.float64]

D1, D4, D5, D6 = 0.089159, 0.10915, 0.09465, 0.0823
A2, A3 = -0.425, -0.39225
QUARTERS = (1, 0, 0, 1, -1, 0)
"""Quarter turns about x of the vendor's six Denavit-Hartenberg rows."""


def _rows(q: Array) -> list[Array]:
    """Six (N, 4, 4) transforms at q (N, 6)."""
    found = []
    for i, (a, d) in enumerate(zip((0, A2, A3, 0, 0, 0), (D1, 0, 0, D4, D5, D6), strict=True)):
        c, s = np.cos(q[:, i]), np.sin(q[:, i])
        ca, sa = (0.0, float(QUARTERS[i])) if QUARTERS[i] else (1.0, 0.0)
        row = np.zeros((len(q), 4, 4))
        row[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
        row[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
        row[:, 2, 1:], row[:, 3, 3] = (sa, ca, d), 1.0
        found.append(row)
    return found


def flange(q: Array) -> Array:
    """(N, 4, 4) at q (N, 6)."""
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for row in _rows(q):
        pose = pose @ row
    return pose


def _factors(q: Array) -> Array:
    """(N, 3) elbow, wrist and shoulder factor of det J; each is zero at one kind of singular posture."""
    reach = A2 * np.cos(q[:, 1]) + A3 * np.cos(q[:, 1] + q[:, 2]) + D5 * np.sin(q[:, 1] + q[:, 2] + q[:, 3])
    return np.stack([np.sin(q[:, 2]), np.sin(q[:, 4]), reach], axis=1)


def _largest() -> float:
    elbow = np.linspace(0.0, np.pi, 200_001)
    reach = np.sqrt(A2**2 + A3**2 + 2 * A2 * A3 * np.cos(elbow)) + D5
    return float(np.max(A2 * A3 * np.sin(elbow) * reach))


LARGEST = _largest()


def manipulability(q: Array) -> Array:
    """(N,) |det J| over its largest at q (N, 6)."""
    return np.asarray(np.abs(A2 * A3 * _factors(q).prod(axis=1)) / LARGEST)


def branch_of(q: Array) -> Array:
    """(N,) 0 to 7: which of the eight kinds of posture q (N, 6) is; no motion above a floor leads to another."""
    return np.asarray((_factors(q) > 0) @ (1, 2, 4))


def postures(poses: Array) -> Array:
    """(N, 8, 6) joint positions within half a turn whose flange is at the poses (N, 4, 4); NaN where there is none."""
    found = np.full((len(poses), 8, 6), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        for k, signs in enumerate(itertools.product((1.0, -1.0), repeat=3)):
            found[:, k] = _one(poses, *signs)
    return np.asarray((found + np.pi) % (2 * np.pi) - np.pi)


def _one(poses: Array, shoulder: float, wrist: float, elbow: float) -> Array:
    """(N, 6) of one choice of the three roots."""
    q = np.empty((len(poses), 6))
    place, turn = poses[:, :3, 3], poses[:, :3, :3]
    centre = place - D6 * turn[:, :, 2]
    away = np.hypot(centre[:, 0], centre[:, 1])
    q[:, 0] = np.arctan2(centre[:, 1], centre[:, 0]) + shoulder * np.arccos(D4 / away) + np.pi / 2
    s, c = np.sin(q[:, 0]), np.cos(q[:, 0])
    q[:, 4] = wrist * np.arccos((place[:, 0] * s - place[:, 1] * c - D4) / D6)
    sign = np.sign(np.sin(q[:, 4]))
    q[:, 5] = np.arctan2(sign * (c * turn[:, 1, 1] - s * turn[:, 0, 1]), sign * (s * turn[:, 0, 0] - c * turn[:, 1, 0]))
    q[:, 1:4] = 0.0
    rows = _rows(q)
    inner = np.linalg.inv(rows[0]) @ poses @ _inverse(rows[4] @ rows[5])
    x, y = inner[:, 0, 3] - D4 * inner[:, 0, 1], inner[:, 1, 3] - D4 * inner[:, 1, 1]  # where the forearm ends
    q[:, 2] = elbow * np.arccos((x**2 + y**2 - A2**2 - A3**2) / (2 * A2 * A3))
    q[:, 1] = np.arctan2(y, x) - np.arctan2(A3 * np.sin(q[:, 2]), A2 + A3 * np.cos(q[:, 2]))
    bend = np.arctan2(inner[:, 1, 0], inner[:, 0, 0])
    q[:, 3] = bend - q[:, 1] - q[:, 2]
    return q


def _inverse(poses: Array) -> Array:
    """(N, 4, 4) inverse transforms, NaN for NaN."""
    found = np.zeros_like(poses)
    found[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    found[:, :3, 3] = -np.einsum("nij,nj->ni", found[:, :3, :3], poses[:, :3, 3])
    found[:, 3, 3] = 1.0
    return found
