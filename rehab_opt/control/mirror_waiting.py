"""A mirrored hand that stands short of its reference: what it cannot do is cut to where it stands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.between_poses import angle_between, distance_between
from rehab_opt.control.interaction import AdmittanceState
from rehab_opt.control.mirror_statement import WHOLE, MirrorStatement
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.symbolic import BufferedFunction

__all__ = ["MirrorWaiting"]

Array = NDArray[np.float64]

STANDS = 0.005, 0.05
"""[m/s, rad/s] A hand up to these stands."""
SHORT = 0.001, 0.01
"""[m, rad] from which a hand counts as short of its reference."""
STUCK = 0.1
"""[s] for which it must have stood while the clock is slowed, before it counts as nearest."""
PATIENCE = 1.0
"""[s] for which the clock waits longer than it goes on, at most, for a hand that does not come to rest either."""


class MirrorWaiting(MirrorStatement):
    """How far the hand stays from the reference at best, and how long the clock has waited.

    `_apart` [m] and `_aside` [rad] are those of a hand that stood, or was waited for long enough: what is nearest to
    the reference, seen from where it is. The clock counts deviations from there on, so that a stretch out of reach is
    followed along its edge, as near as the hand comes, and none of it is left out. They shrink as the hand comes
    nearer.
    """

    clock: ReferenceClock
    followed: Array
    _interaction: AdmittanceState
    _rate: float
    _moving: BufferedFunction

    def _begin_waiting(self) -> None:
        self._waited, self._stood, self._apart, self._aside = 0.0, 0.0, 0.0, 0.0
        self._short_by = self._beyond_person = (0.0, 0.0)

    def _beyond(self, here: Array, aim: Array) -> tuple[float, float]:
        """[m, rad] by which the hand is further from what it is to do than where it stood at best."""
        away, turned = distance_between(here, aim), angle_between(here, aim)
        self._apart, self._aside = min(self._apart, away), min(self._aside, turned)
        return away - self._apart, turned - self._aside

    def _missing(self, target: Array) -> tuple[float, float]:
        """[m, rad] of the reference that person and robot stay short of, from what the person's arm can do of it."""
        beyond = (0.0, 0.0)
        if target is not self.followed:
            beyond = distance_between(self.followed, target), angle_between(self.followed, target)
        self._beyond_person = beyond
        return self._apart + beyond[0], self._aside + beyond[1]

    def _cut(self, here: Array, target: Array) -> Array:
        """(3,) [m] the place that deviations are bounded around: towards the hand by what it stays short of at best."""
        part = min(self._apart / max(distance_between(here, target), 1e-12), 1.0)
        place: Array = target[:3, 3] + part * (here[:3, 3] - target[:3, 3])
        return place

    @property
    def _short(self) -> bool:
        """Whether the hand follows at a distance, because it stood there."""
        return self._apart > SHORT[0] or self._aside > SHORT[1]

    def _note_waiting(self, here: Array, aim: Array) -> None:
        """Take the place of a hand that stands while the clock is slowed or late for the nearest one that it has."""
        if (self._rate >= WHOLE and self.clock.current) or self._interaction.pace < 1.0:
            self._waited = self._stood = 0.0
            return
        if self._rate <= 0.02:
            self.counts["waited"] += 1
            self._waited += self.dt
        else:  # what was waited for before it went on is no reason to cut the hand short now
            self._waited = max(self._waited - self.dt, 0.0)
        self._moving.of(self._q, self._last)
        x, y, z, turning_x, turning_y, turning_z = self._moving.outputs[1].tolist()
        still = math.hypot(x, y, z) <= STANDS[0] and math.hypot(turning_x, turning_y, turning_z) <= STANDS[1]
        self._stood = self._stood + self.dt if still else 0.0
        if self._stood < STUCK and self._waited < PATIENCE:
            return
        self._apart, self._aside = distance_between(here, aim), angle_between(here, aim)
        self.counts["cut"] += self._short
        self._waited = self._stood = 0.0
