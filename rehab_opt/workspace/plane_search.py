"""Find the distance of a probe from the slice, and the posture nearest to the probe, from many starts."""

from __future__ import annotations

import math
import threading
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.optim.nlp import NLPAnswer
from rehab_opt.optim.nlp_solvers import NLPSolver, nlp_solver
from rehab_opt.optim.nlp_sqp import SQP
from rehab_opt.optim.recorder import recorder_now
from rehab_opt.symbolic import Compile
from rehab_opt.symbolic.compiled import how
from rehab_opt.workspace.plane_approach import Approached, PlaneApproach
from rehab_opt.workspace.plane_statement import PlaneStatement, spread_postures

__all__ = ["REACHED", "Nearest", "PlaneSearch"]

Array = NDArray[np.float64]

REACHED = 1e-6
"""[m] A probe nearer to the slice than this counts as inside."""
VIOLATION = 1e-8
"""[m, rad] Largest accepted violation of the plane or the handle's cone."""
TOLERANCE = 1e-9
ASIDE = 0.05
"""Accepted violation of plane or handle in an approach, as a fraction of the distance from the probe."""
KEPT = 8
BACKUP_CALLS = 64
"""Largest number of calls of the backup solver, which takes 10 ms each."""


class Nearest(NamedTuple):
    """A point of the slice near a probe: the nearest one, unless the search ended in a local minimum."""

    distance: float
    """[m] distance from the probe; 0 if it was reached."""
    x: float
    """[m] coordinates of the point."""
    y: float
    posture: Array
    """(k,) positions of the free joints."""


class _Solvers(threading.local):
    """Solvers of this thread; arms that differ only in numbers share them."""

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], tuple[SQP, PlaneApproach]] = {}

    def of(self, statement: PlaneStatement, compile: Compile) -> tuple[SQP, PlaneApproach]:
        key = (statement.nearest, how(compile), recorder_now())  # new solvers register with the recorder
        if key not in self._made:
            if len(self._made) >= KEPT:
                del self._made[next(iter(self._made))]
            sqp = SQP(statement.nearest, tolerance=TOLERANCE, compile=compile)
            self._made[key] = sqp, PlaneApproach(statement, compile=compile)
        return self._made[key]


_solvers = _Solvers()


class PlaneSearch:
    """Solves `PlaneStatement.nearest` for one arm and one plane. One thread at a time.

    Parameters
    ----------
    statement : of the arm.
    height : [m] of the plane.
    compile : as for `SQP`.

    Attributes
    ----------
    solves, uncertified, failures : counts of all solver calls, of those that satisfied the rows without a certified
        minimum, and of those that ended off the plane or with a tilted handle.
    """

    def __init__(self, statement: PlaneStatement, *, height: float, compile: Compile = None) -> None:
        self.statement, self.height = statement, height
        self._sqp, self._approach = _solvers.of(statement, compile)
        self._parameters = np.concatenate([statement.fixed, [height, 0.0, 0.0, statement.size**-2]])
        self.solves = self.uncertified = self.failures = 0
        self._backup_calls = 0

    def nearest(self, x: float, y: float, start: Array, *, approached: bool = False) -> Nearest | None:
        """Local answer for the probe (x, y) from the posture `start` (k,); None if no answer satisfies the rows.

        If the answer is not certified, the search is repeated from a start that `PlaneApproach` moves, unless the start
        is `approached` already.
        """
        self._parameters[-3], self._parameters[-2] = x, y
        self._sqp.parameters[:] = self._parameters
        answer = self._sqp.solve(start)
        self.solves += 1
        if not (approached or (answer.certified and answer.violation <= VIOLATION)):  # NaN and infinity too
            nearer = self._approach.near(self._parameters, np.array([[x, y]]), start[None]).postures[0]
            again = self._sqp.solve(nearer)
            self.solves += 1
            if (not again.violation <= VIOLATION, again.cost) < (not answer.violation <= VIOLATION, answer.cost):
                answer = again
        if not answer.violation <= VIOLATION:
            self.failures += 1
            return None
        self.uncertified += not answer.certified
        return _nearest(answer)

    def approached(self, probes: Array, starts: Array, below: Array | float = math.inf) -> Approached:
        """Approximate answers for probes (N, 2) from postures (N, k), in a tenth of the time of `nearest`.

        Distances are 0 if the probe was reached, infinite if the posture is not at the slice, and otherwise accurate to
        a few per cent: the point is near the nearest point of the slice, but not certified. Postures that seem to end
        further off than `below` [m] are dropped.
        """
        found = self._approach.near(self._parameters, probes, starts, below)
        away = np.where(found.distances > REACHED, found.distances, 0.0)
        off = np.where(away > 0.0, found.misses > np.maximum(VIOLATION, ASIDE * away), found.misses > VIOLATION)
        away[off] = np.inf
        return found._replace(distances=away)

    def by_backup(self, x: float, y: float, start: Array) -> Nearest | None:
        """Like `nearest`, but with another solver if the first one fails; used at most `BACKUP_CALLS` times."""
        if self._backup_calls >= BACKUP_CALLS:
            return None
        self._backup_calls += 1
        solver = self._backup
        solver.parameters[:] = self._parameters
        solver.parameters[-3:-1] = x, y
        answer = solver.solve(start)
        self.solves += 1
        if not answer.violation <= VIOLATION:
            self.failures += 1
            return None
        return _nearest(answer)

    @cached_property
    def _backup(self) -> SQP | NLPSolver:
        return nlp_solver(self.statement.nearest, "ipopt", tolerance=TOLERANCE)

    def spread(self, count: int) -> list[Nearest]:
        """Points of the slice, searched from `count` postures spread over the range of motion.

        Each posture searches the point of the slice nearest to its own hand, so that the points are spread, too. The
        distance is 0 if that point is the hand itself.
        """
        statement = self.statement
        arm, free = statement.arm, statement.free
        q = np.where(arm.locked, arm.lower, 0.0)
        postures = spread_postures(arm, free, count)
        hands = np.empty((count, 2))
        for posture, hand in zip(postures, hands, strict=True):
            q[free] = posture
            hand[:] = arm.pose(q)[:2, 3]
        at = self.approached(hands, postures)
        found: list[Nearest | None] = []
        for (x, y), distance, near in zip(hands.tolist(), at.distances.tolist(), at.postures, strict=True):
            found.append(Nearest(0.0, x, y, near) if distance == 0.0 else self.nearest(x, y, near, approached=True))
        return [answer for answer in found if answer is not None]


def _nearest(answer: NLPAnswer) -> Nearest:
    distance, x, y = answer.report.tolist()
    return Nearest(distance if distance > REACHED else 0.0, x, y, answer.x)
