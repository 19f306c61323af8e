"""What is timed of the corpus: one sequence of each family, and solvers going forth and back along it, warm."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from rehab_opt.comparison.entrants import Entrant
from rehab_opt.comparison.instances import RecordedQPs
from rehab_opt.comparison.sequence import QPSequence, read_sequence, shipped_sequences

__all__ = ["along", "read", "representatives"]


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
