"""What the joints were told and what they did, tick by tick: kept where the two differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Plant

__all__ = ["JointMotion", "MotionLog"]

Array = NDArray[np.float64]


class JointMotion(NamedTuple):
    """N ticks; everything holds at the beginning of its tick, commands are held during it."""

    time: Array
    """(N,) [s]"""
    commanded: Array
    """(N, n) velocities [rad/s, m/s]"""
    velocity: Array
    """(N, n) true ones"""
    measured: Array
    """(N, n) [rad, m] positions as the controller saw them"""
    effort: Array
    """(N, n) [N m, N] of the drives in the tick before"""


class MotionLog:
    """Writes down a plant's ticks; an ideal one needs no log, since it does as it is told."""

    def __init__(self, plant: Plant) -> None:
        self._plant = None if isinstance(plant, IdealJoints) else plant
        self._rows: list[tuple[float, Array, Array, Array, Array]] = []

    def note(self, command: Array) -> None:
        """The command of a tick, before it is sent."""
        if self._plant is not None:
            truth, seen = self._plant.truth, self._plant.measured
            self._rows.append((truth.time, np.array(command), truth.velocity, seen.position, truth.effort))

    @property
    def motion(self) -> JointMotion | None:
        """All of it; None of an ideal plant."""
        if not self._rows:
            return None
        return JointMotion(*map(np.array, zip(*self._rows, strict=True)))
