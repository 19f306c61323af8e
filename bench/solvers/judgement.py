"""What a solve is worth: our certificate says so, the solver's word only says what kind of failure it is."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.solvers.instances import Instances
from bench.solvers.reference import Reference
from bench.solvers.worker import Timed
from rehab_opt.optim.certificate import is_certified

__all__ = ["HOPELESS", "Judge", "Judged", "Outcome"]

Array = NDArray[np.float64]

HOPELESS = frozenset({"infeasible", "nan"})
"""Marks of instances that have no answer."""


class Outcome(StrEnum):
    """What became of one solve."""

    SOLVED = "solved"
    WRONG = "wrong answer"
    """It claims a solution, and the certificate fails."""
    NO_ANSWER = "no answer"
    """It says that it found none; on an instance that has one."""
    TOO_LATE = "too late"
    RAISED = "raised"
    """An exception, or a process that ended."""
    NOT_TRIED = "not tried"
    """After several solves of the same pass that were too late."""
    SAID_NO = "said no"
    """Of an instance that has no solution: the right answer. An exception of the solver's kind counts."""
    CLAIMED = "claimed an answer"
    """Of an instance that has none."""


class Judged(NamedTuple):
    """One solve with its verdict."""

    outcome: Outcome
    seconds: float
    residual: float
    """Of the certificate, infinite where there was no answer."""
    distance: float
    """From the reference, in the statement's units; NaN where there is no reference, or no unique answer."""
    said: str = ""


class Judge:
    """Judges claims about one sequence.

    Parameters
    ----------
    references : of each tick.
    limit : [s] of a solve.
    """

    def __init__(self, sequence: Instances, references: tuple[Reference, ...], *, limit: float) -> None:
        self._sequence, self._references, self._limit = sequence, references, limit

    def hopeless(self, tick: int) -> bool:
        """Whether the instance has no answer."""
        return bool(HOPELESS & {*self._sequence.marks_of(tick)})

    def judged(self, tick: int, timed: Timed) -> Judged:
        """The verdict on one solve."""
        if timed.seconds > self._limit:
            return self.too_late(tick)
        if timed.claim is None:
            return Judged(Outcome.RAISED, timed.seconds, np.inf, np.nan, timed.raised)
        claim = timed.claim
        residual = self._sequence.residual(tick, claim.answer)
        if self.hopeless(tick):
            outcome = Outcome.CLAIMED if claim.word else Outcome.SAID_NO
            return Judged(outcome, timed.seconds, residual, np.nan, claim.said)
        if is_certified(residual, self._sequence.tolerance):
            # An answer that is right counts, whatever its solver says of it.
            distance = self._references[tick].distance(claim.answer.x)
            return Judged(Outcome.SOLVED, timed.seconds, residual, distance, claim.said)
        outcome = Outcome.WRONG if claim.word else Outcome.NO_ANSWER
        return Judged(outcome, timed.seconds, residual, np.nan, claim.said)

    def too_late(self, tick: int) -> Judged:
        """The verdict on a solve that was cut off."""
        return Judged(Outcome.TOO_LATE, self._limit, np.inf, np.nan, f"more than {self._limit:g} s")
