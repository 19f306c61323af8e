"""What is timed of the corpus: one sequence of each family, and solvers going forth and back along it, warm."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any, NamedTuple

from bench.qp_recording.sequence import QPSequence, read_sequence
from bench.solvers.entrant import Entrant
from bench.solvers.instances import RecordedQPs
from bench.solvers.shipped import shipped_sequences
from rehab_opt.optim.certificate import is_certified

__all__ = ["Quality", "along", "quality", "read", "representatives"]


def representatives() -> list[str]:
    """The first sequence of each family that holds ordinary ticks alone: times of the others have two humps."""
    chosen: dict[str, str] = {}
    for name in shipped_sequences():
        family = name.partition("/")[0]
        if family not in chosen and not any(read(name).marks):
            chosen[family] = name
    return list(chosen.values())


@cache
def read(name: str) -> QPSequence:
    """A shipped sequence."""
    return read_sequence(shipped_sequences()[name])


def along(entrant: Entrant, sequence: QPSequence) -> Callable[[], Any]:
    """A call that solves the next instance, warm; what it is given has been prepared before."""
    solver = entrant.make(RecordedQPs(sequence), entrant.solver)
    given = [solver.prepared(qp) for qp in sequence]
    stream: Iterator[Any] = itertools.cycle([*given, *reversed(given)])  # a jump would spoil the warm start
    return lambda: solver.solve(next(stream), warm=True)


class Quality(NamedTuple):
    """How good a solver's answers are: one that fails is often fast."""

    certified: float
    """Fraction of the ticks whose answer our certificate accepts."""
    residual: float
    """Largest residual of the certificate; infinite where an answer has none."""

    @classmethod
    def of(cls, residuals: Iterable[float], tolerance: float) -> Quality:
        """Of the certificate's residuals, one a tick."""
        found = list(residuals)
        worst = max(residual if residual >= 0.0 else math.inf for residual in found)
        return cls(sum(is_certified(residual, tolerance) for residual in found) / len(found), worst)


def quality(entrant: Entrant, sequence: QPSequence) -> Quality:
    """Of a solver that solves the ticks one after the other, warm."""
    recorded = RecordedQPs(sequence)
    solver = entrant.make(recorded, entrant.solver)
    claims = (solver.claim(qp, solver.solve(solver.prepared(qp), warm=True)) for qp in sequence)
    residuals = (recorded.residual(tick, claim.answer) for tick, claim in enumerate(claims))
    return Quality.of(residuals, sequence.tolerance)
