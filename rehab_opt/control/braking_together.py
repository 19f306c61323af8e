"""Braking of the whole robot together: every velocity shrinks by the same fraction a tick, and no position drifts on.

With T the time in which every joint can stop from its largest speed, and u the velocities of all joints, braking is
u <- (1 - dt/T) u. The posture where that ends is the stop posture

    z = q + T u.

Braking does not move it: after a tick q + dt u + T (1 - dt/T) u = z. A controller that keeps its limits at z and on the
way from q to z can therefore always brake without breaking any of them, within every joint's acceleration, since
|u| dt/T <= v dt/T <= a dt. What a tick adds to u moves z by T times as much; that is all a limit must ask about.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from rehab_opt.control.stopping import max_change
from rehab_opt.kinematics.chain import SerialChain

__all__ = ["BrakingTogether", "slowed_together", "ticks_to_rest"]

SLACK = 1.1
"""T is longer by this than stopping takes: a task and a limit that turn on the way need acceleration, too."""
FARTHEST = 0.2
"""[rad, m] Way of the stop posture in a tick, at most: limits are tangents there."""
LATER = 0.3
"""[s] after T / 1.1 a velocity that must go is gone. Of 1 s, which the law has, the bend of the way takes the rest."""


class BrakingTogether:
    """Braking of one robot in proportion.

    Parameters
    ----------
    chain : its velocity and acceleration limits.
    dt : tick [s].
    moving : joints that move at all, by number from 0; one that stands does not make T longer.
    """

    def __init__(self, chain: SerialChain, dt: float, *, moving: Sequence[int]) -> None:
        self.time = SLACK * max(dt, float(np.max((chain.velocity / chain.acceleration)[moving])))
        """T [s]."""
        farthest = np.maximum(FARTHEST, SLACK * chain.velocity * dt) / self.time
        self.change = ca.fmin(max_change(chain, dt), ca.DM(farthest))
        """(n,) largest change of a velocity in a tick: the acceleration's, and z moves by `FARTHEST` at most."""
        self._left = 1 - dt / self.time
        stopping = self.time / SLACK
        self._part = stopping / (stopping + LATER)

    def slower(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after a tick of braking that leaves the stop posture where it is."""
        return self._left * velocity

    def slowest(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after a tick of the hardest braking; it ends at rest, on the way to the stop posture."""
        return slowed_together(velocity, self.change)

    def leaves(self, velocity: ca.SX) -> ca.SX:
        """Fraction that is left of a velocity that must go, at most, so that it is gone `LATER` than T / 1.1.

        `slower` alone never ends.
        """
        return ca.fmin(self._left, 1 - self._part * _taken_away(velocity, self.change))


def ticks_to_rest(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """Ticks in which velocities (n,) come to rest that change by `change` (n,) a tick at most: the slowest one's."""
    return ca.mmax(ca.fabs(velocity) / change)


def slowed_together(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """(n,) velocities after a tick in which all shrink by the same fraction, as large as `change` (n,) allows."""
    return velocity * (1 - _taken_away(velocity, change))


def _taken_away(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """Fraction that such a tick takes away."""
    return 1 / ca.fmax(ticks_to_rest(velocity, change), 1)
