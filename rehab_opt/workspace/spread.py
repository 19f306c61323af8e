"""Postures spread over a range of motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["sampling_range", "spread_postures"]

Array = NDArray[np.float64]


def spread_postures(arm: SerialChain, free: NDArray[np.int64], count: int) -> Array:
    """(count, k) values of the `free` joints, evenly over their limits (Sobol's sequence: always the same ones)."""
    from scipy.stats import qmc  # noqa: PLC0415  (heavy)

    lower, upper = arm.lower[free], arm.upper[free]
    low, high = sampling_range(lower, upper, arm, free)
    drawn = qmc.Sobol(len(free), seed=0).random(count)
    postures: Array = np.clip(low + (high - low) * drawn, lower, upper)
    return postures


def sampling_range(lower: Array, upper: Array, arm: SerialChain, free: NDArray[np.int64]) -> tuple[Array, Array]:
    """Limits (k,) cut to one turn of a revolute joint, and to the chain's size of a prismatic one."""
    size = sum(row.across + abs(row.along) for row in arm.rows) + 1.0
    half = np.array([size if arm.rows[i].prismatic else math.pi for i in free])
    centre = np.clip(0.0, lower + half, np.maximum(upper - half, lower + half))
    return np.maximum(lower, centre - half), np.minimum(upper, centre + half)
