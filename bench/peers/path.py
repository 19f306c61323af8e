"""The path every contender follows: a circle of the hand with a swing of its orientation, sampled at the tick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt import SerialChain

__all__ = ["START", "HandPath", "circle"]

Array = NDArray[np.float64]

START = np.array([0.3, -1.3, 1.7, -1.9, -1.4, 0.2])
"""(6,) UR5 joint angles [rad] where the path begins: away from every singularity and limit."""


class HandPath(NamedTuple):
    """N samples of a hand motion, base frame."""

    poses: Array
    """(N, 4, 4)"""
    twists: Array
    """(N, 6) linear rows first, of the motion from this sample on [m/s, rad/s]."""


def circle(
    chain: SerialChain,
    samples: int,
    *,
    dt: float,
    radius: float = 0.1,
    period: float = 2.0,
    swing: float = 0.3,
    onset: float = 0.15,
) -> HandPath:
    """A circle [m] in the plane y, z through the start pose, with the hand swinging about base x by `swing` [rad].

    The orientation swings once a round and returns. The circle begins at rest and reaches its speed with the time
    constant `onset` [s], so that no contender's acceleration bound is in the way.
    """
    start = chain.pose(START)
    rate = 2 * math.pi / period
    time = dt * np.arange(samples)
    phase = rate * (time - onset * -np.expm1(-time / onset))
    phase_rate = rate * -np.expm1(-time / onset)
    poses = np.tile(start, (samples, 1, 1))
    poses[:, 1, 3] += radius * np.sin(phase)
    poses[:, 2, 3] += radius * (np.cos(phase) - 1)
    tilt = swing * np.sin(phase)
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(tilt, (1.0, 0.0, 0.0))).as_matrix() @ start[:3, :3]
    twists = np.zeros((samples, 6))
    twists[:, 1] = radius * phase_rate * np.cos(phase)
    twists[:, 2] = -radius * phase_rate * np.sin(phase)
    twists[:, 3] = swing * phase_rate * np.cos(phase)
    return HandPath(poses, twists)
