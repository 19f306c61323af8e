"""Why a led hand is not where, or not when, the reference is: every second of a run under one cause."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.mirror_statement import WHOLE
from rehab_opt.session.mirror.outcome import Led

__all__ = ["CAUSES", "cause_seconds", "causes"]

CAUSES = ("followed", "late", "person's arm", "floor", "keep-out", "robot's reach", "stopped")
"""In the order that they are shown. Late: the reference is slowed, or the hand behind it. Where several hold, the first
of `stopped`, `person's arm`, `floor`, `keep-out`, `robot's reach`, `late` counts."""
NEAR, TURNED = 5e-3, math.radians(5.0)
"""[m, rad] by which a hand may stay short of the reference and still follow it."""
AT_FLOOR, AT_PLANE = 0.02, 0.005
"""Of w / w_max above the floor, and [m] above a plane, up to which it counts as what is in the way."""


def causes(led: Led, bounds: HandBounds) -> NDArray[np.int_]:
    """(M,) place in `CAUSES` of each tick."""
    person = (led.person[:, 0] > NEAR) | (led.person[:, 1] > TURNED)
    robot = (led.short - led.person > (NEAR, TURNED)).any(axis=1) & ~person
    behind = (led.deviation > NEAR + led.short[:, 0]) | (led.turn > TURNED + led.short[:, 1])
    found = np.where((led.pace < WHOLE) | behind, 1, 0)
    found[robot] = 5
    for k in np.flatnonzero(robot).tolist():
        if any(bounds.least_height(led.q[k], plane) < AT_PLANE for plane in bounds.planes):
            found[k] = 4
    found[robot & (led.manipulability < bounds.floor + AT_FLOOR)] = 3
    found[person] = 2
    found[np.isin(led.status, ("braking", "holding"))] = 6
    return np.asarray(found)


def cause_seconds(led: Led, bounds: HandBounds) -> dict[str, float]:
    """[s] of a run under each cause; together they are its ticks."""
    counted = np.bincount(causes(led, bounds), minlength=len(CAUSES)) * bounds.dt
    return {name: float(seconds) for name, seconds in zip(CAUSES, counted, strict=True)}
