"""A mirrored hand's reference clock that waits: what is left out, so that the motion goes on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.between_poses import angle_between
from rehab_opt.control.interaction import AdmittanceState
from rehab_opt.control.mirror_statement import CALM, MirrorStatement
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.symbolic import BufferedFunction

__all__ = ["MirrorWaiting"]

Array = NDArray[np.float64]

STUCK = 0.1, 0.005
"""[s, m/s] How long the clock must have waited, and how slow the hand be, before a stretch of path is given up."""
PATIENCE = 0.5
"""[s] of waiting after which the hand is led on to a later pose."""
LEAVE_OUT = 0.25
"""[s] of a recording that are left out first; twice as many each time it does not help."""


class MirrorWaiting(MirrorStatement):
    """How long the clock has waited, and where it goes on."""

    clock: ReferenceClock
    _interaction: AdmittanceState
    _rate: float
    _moving: BufferedFunction

    def _begin_waiting(self) -> None:
        self._waited, self._gone_on, self._ahead = 0.0, 0.0, LEAVE_OUT

    def _note_waiting(self, here: Array, *, foreseen: bool) -> None:
        """Leave out the stretch the clock waits at, once the hand stands.

        The next pose that is near the hand again is gone on from. Where there is none, the hand is led, calmly and as
        far as it goes, to the newest pose, or of a recording, whose end is known, to one a little later, then later
        still.
        """
        if self._rate > 0.02 or self._interaction.pace < 1.0:
            self._count_pace()
            return
        self.counts["waited"] += 1
        self._waited += self.dt
        self._moving.of(self._q, self._last)
        x, y, z, *_ = self._moving.outputs[1].tolist()
        if self._waited < STUCK[0] or math.sqrt(x * x + y * y + z * z) > STUCK[1]:
            return
        positions, poses, times = self.clock.waiting()
        near = np.flatnonzero(np.linalg.norm(positions - here[:3, 3], axis=1) <= CALM * self.max_deviation)
        beyond = np.linalg.norm(positions - self.clock.read()[0][:3, 3], axis=1)
        for index in near.tolist():
            if angle_between(here, poses[index]) <= CALM * self.max_turn and beyond[: index + 1].max() > 1e-3:
                self.clock.skip(index + 1)
                self.counts["left out"] += 1
                self._waited = 0.0
                return
        if self._waited < PATIENCE or len(poses) < 2:
            return
        later = min(int(np.searchsorted(times, self._ahead)), len(poses) - 1) if foreseen else len(poses) - 1
        self.clock.lead_to(later + 1, here)
        self.counts["left out"] += 1
        self._waited, self._gone_on, self._ahead = 0.0, 0.0, 2.0 * self._ahead

    def _count_pace(self) -> None:
        """The clock went on in this tick: what it waited is forgotten, and what it left out is left behind."""
        self._waited = 0.0
        self._gone_on += self._rate * self.dt
        if self._gone_on > 1.0:
            self._ahead = LEAVE_OUT
