"""A plant to which sensor faults are added during a run: a frozen encoder, noise, delay."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.plants.plant import Measurement, Plant, Truth

__all__ = ["TouchedPlant"]

Array = NDArray[np.float64]

LONGEST = 10.0
"""Measurements are stored for this time [s], which is therefore the largest delay."""


class TouchedPlant:
    """A `Plant` that adds sensor faults to another plant; the faults can be set at any time.

    Attributes
    ----------
    frozen : number of the joint whose encoder repeats its last value; -1 for none.
    noise : standard deviation [rad, m] of noise on every position.
    delay : additional delay of measurements [s], 0 to 10.

    Parameters
    ----------
    plant : the plant without faults. seed : seed of the noise.
    """

    def __init__(self, plant: Plant, *, seed: int = 0) -> None:
        self.plant, self.dt = plant, plant.dt
        self.frozen, self.noise, self.delay = -1, 0.0, 0.0
        self._rng = np.random.default_rng(seed)
        self._kept: deque[Measurement] = deque(maxlen=math.ceil(LONGEST / plant.dt) + 1)
        self._measured = self._seen(plant.measured)

    @property
    def measured(self) -> Measurement:
        """The measurement with faults."""
        return self._measured

    @property
    def truth(self) -> Truth:
        """True state of the plant."""
        return self.plant.truth

    def reset(self, position: ArrayLike) -> Measurement:
        """Reset the plant to rest at `position` (n,); a frozen encoder then repeats this position."""
        self._kept.clear()
        self._measured = self.plant.reset(position)
        self._kept.append(self._measured)
        return self._measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Run one tick of the plant; return its measurement with the sensor faults."""
        self._measured = self._seen(self.plant.step(command, push))
        return self._measured

    def _seen(self, now: Measurement) -> Measurement:
        kept = self._kept
        kept.append(now)
        seen = now if self.delay == 0.0 else kept[-1 - min(round(self.delay / self.dt), len(kept) - 1)]
        if not (self.noise or 0 <= self.frozen < len(seen.position)):
            return seen
        position = seen.position + self.noise * self._rng.standard_normal(len(seen.position))
        if 0 <= self.frozen < len(position):
            position[self.frozen] = self._measured.position[self.frozen]
        return seen._replace(position=position)
