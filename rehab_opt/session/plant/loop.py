"""The closed loop of a run: a controller is asked, the plant moves, what was commanded and what was so is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Measurement, Plant

__all__ = ["JointMotion", "MotionLog", "Sent", "closed_loop"]

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


TICKS_A_REPORT = 100


class Sent(NamedTuple):
    """What a controller answers in one tick."""

    velocity: Array
    """(n,) of the joints [rad/s, m/s]; what is kept."""
    command: Array
    """What the plant takes; the same, but for a chair, which takes wheel speeds."""


def closed_loop(
    plant: Plant,
    start: Array,
    controller: Callable[[int, Measurement], Sent | None],
    *,
    ticks: int,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> JointMotion | None:
    """Run until the controller answers None, or for so many ticks.

    Parameters
    ----------
    start : (n,) joint values [rad, m]; the plant is at rest.
    controller : the tick's number and what the sensors say -> its answer. It keeps what it wants kept of the tick, and
        may look at `plant.truth`, which no real one can.
    progress : told the tick and how many there may be.

    Returns
    -------
    What was commanded and what was so; None of an ideal plant, which does as it is told.
    """
    log, seen = MotionLog(plant), plant.reset(start)
    for k in range(ticks):
        sent = controller(k, seen)
        if sent is None:
            break
        log.note(sent.velocity)
        seen = plant.step(sent.command)
        if k % TICKS_A_REPORT == 0:
            progress(k, ticks)
    progress(ticks, ticks)
    return log.motion
