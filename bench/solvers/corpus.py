"""How each sequence of the corpus is made, by its name."""

from __future__ import annotations

from functools import cache

from bench.qp_recording.sequence import QPSequence
from bench.solvers.controller_runs import CONTROLLER_RUNS
from bench.solvers.marked import MAKERS, TICKS
from bench.solvers.problem_runs import PROBLEM_RUNS
from rehab_opt.errors import ConfigurationError

__all__ = ["made", "names"]


def names() -> tuple[str, ...]:
    """Of all sequences, in alphabetical order."""
    return tuple(sorted({**PROBLEM_RUNS, **CONTROLLER_RUNS, **MAKERS}))


@cache
def made(name: str) -> QPSequence:
    """The sequence of that name, from a new run of its controller; twice the same numbers, to rounding.

    Raises
    ------
    ConfigurationError : there is none of that name.
    """
    if name in PROBLEM_RUNS:
        return PROBLEM_RUNS[name].sequence(name)
    if name in CONTROLLER_RUNS:
        return CONTROLLER_RUNS[name](name)
    if name in MAKERS:
        origin, make = MAKERS[name]
        return make(made(origin).first(TICKS), name)
    raise ConfigurationError("name", name, f"one of {', '.join(names())}")
