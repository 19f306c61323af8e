"""The closed loop of a run: a controller is asked, what it answers is kept, the plant moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.session.plant.motion import JointMotion, MotionLog

__all__ = ["Sent", "closed_loop"]

Array = NDArray[np.float64]

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
