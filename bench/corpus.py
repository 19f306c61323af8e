"""What is timed of the corpus: one sequence of each family, and solvers going forth and back along it, warm."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from bench.solvers.entrant import Entrant
from bench.solvers.instances import RecordedQPs
from bench.solvers.shipped import shipped_sequences
from rehab_opt.optim.certificate import is_certified
from rehab_opt.qp_recording.sequence import QPSequence, read_sequence

__all__ = ["along", "certified_fraction", "read", "representatives"]


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


def certified_fraction(entrant: Entrant, sequence: QPSequence) -> float:
    """Of the ticks, one after the other and warm: the share whose answer our certificate accepts."""
    recorded = RecordedQPs(sequence)
    solver = entrant.make(recorded, entrant.solver)
    accepted = 0
    for tick, qp in enumerate(sequence):
        claim = solver.claim(qp, solver.solve(solver.prepared(qp), warm=True))
        accepted += is_certified(recorded.residual(tick, claim.answer), sequence.tolerance)
    return accepted / len(sequence)
