"""The reach that sensitivities are measured on: minimum jerk, 0.2 m in 1 s, with and without noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LENGTH, SECONDS = 0.2, 1.0
SEEDS = 40

Array = NDArray[np.float64]


def reach(rate: float, *, rest: float = 0.0, axes: int = 2) -> tuple[Array, Array]:
    """Times (N,) [s] and points (N, axes) [m] of the reach along x, at rest for `rest` seconds before and after."""
    time = np.arange(round((SECONDS + 2 * rest) * rate) + 1) / rate
    u = np.clip((time - rest) / SECONDS, 0, 1)
    points = np.zeros((len(time), axes))
    points[:, 0] = LENGTH * (10 * u**3 - 15 * u**4 + 6 * u**5)
    return time, points


def noisy(points: Array, size: float, seed: int) -> Array:
    return points + np.random.default_rng(seed).normal(0, size, points.shape)
