"""Recorded movements of a hand that a known field leads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt import PotentialField
from rehab_opt.field.demonstration import Demonstration

__all__ = ["WAY", "led_hands"]

Array = NDArray[np.float64]
S = np.linspace(0.0, 1.0, 300)
WAY = np.column_stack([-0.15 + 0.3 * S, 0.4 + 0.05 * np.sin(3 * S)])


def led_hands(
    truth: PotentialField, *, count: int = 10, samples: int = 300, noise: float = 0.0, sway: float = 0.01, seed: int = 0
) -> list[Demonstration]:
    """Reaches along the field's path in two seconds, swaying beside it by `sway` [m]; noise [N] on the force."""
    rng, path = np.random.default_rng(seed), truth.paths[0]
    t = np.linspace(0.0, 1.0, samples)
    length = path.travelled[-1] * (10 * t**3 - 15 * t**4 + 6 * t**5)
    on_path = np.column_stack([np.interp(length, path.travelled, column) for column in path.points.T])
    hands = []
    for _ in range(count):
        beside = rng.normal(0, sway, 2) * np.sin(3 * np.pi * t[:, None] + rng.uniform(0, 6, 2))
        x = on_path + beside * np.sin(np.pi * t[:, None])
        v = np.gradient(x, 2.0 * t, axis=0)
        hands.append(Demonstration(x, truth.force(x, v) + noise * rng.standard_normal(x.shape), v))
    return hands
