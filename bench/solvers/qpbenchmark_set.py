"""The corpus as a test set of qpbenchmark, which brings its own measures and reports.

    qpbenchmark bench/solvers/qpbenchmark_set.py --results-path corpus.csv run --author me

It solves each problem by itself, cold: what warm starts are worth, and what infeasible or broken ticks do, is for
`python -m bench.solvers`. qpbenchmark (Apache-2.0) is looked for only when the class is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from typing import Any

from bench.qp_recording.sequence import QPSequence, read_sequence
from bench.solvers.shipped import shipped_sequences
from rehab_opt.errors import ConfigurationError

__all__ = ["corpus_test_set"]

CLASS = "QpbenchmarkSet"
"""What qpbenchmark looks for in a file of this name."""
EVERY = 20
"""Ticks from one problem to the next: neighbours are too alike to count both."""
UNSOLVABLE = frozenset({"infeasible", "nan"})


def corpus_test_set(*, families: Sequence[str] | None = None, every: int = EVERY) -> Any:
    """A `qpbenchmark.TestSet` of every so many ticks of the shipped sequences that have a solution.

    Parameters
    ----------
    families : which; all by default.
    every : ticks from one problem to the next.

    Raises
    ------
    ConfigurationError : a family that is not shipped, or no count. ImportError : qpbenchmark is not installed.
    """
    return _test_set_class()(families=families, every=every)


@cache
def _test_set_class() -> type:
    """The class; made when it is asked for, since its base belongs to qpbenchmark."""
    qpbenchmark: Any = import_module("qpbenchmark")

    class QpbenchmarkSet(qpbenchmark.TestSet):  # type: ignore[misc]
        """QPs of rehabilitation robots, recorded from their controllers."""

        title = "Rehabilitation robots"
        description = "QPs that the controllers of rehabilitation and assistive robots solve, recorded from runs."
        sparse_only = False

        def __init__(self, *, families: Sequence[str] | None = None, every: int = EVERY) -> None:
            if every < 1:
                raise ConfigurationError("every", every, "a number of ticks, one or more")
            self._sequences = _sequences(families)
            self._every = every
            super().__init__()

        def __iter__(self) -> Iterator[Any]:
            for sequence in self._sequences:
                for tick in range(0, len(sequence), self._every):
                    if not UNSOLVABLE & set(sequence.marks_of(tick)):
                        problem = sequence.problem(tick)
                        yield qpbenchmark.Problem.from_qpsolvers(problem, f"{sequence.name}#{tick}")

    return QpbenchmarkSet


def _sequences(families: Sequence[str] | None) -> list[QPSequence]:
    shipped = shipped_sequences()
    known = dict.fromkeys(name.partition("/")[0] for name in shipped)
    for family in families or ():
        if family not in known:
            raise ConfigurationError("families", family, f"of {', '.join(known)}")
    wanted = known if families is None else families
    return [read_sequence(path) for name, path in shipped.items() if name.partition("/")[0] in wanted]


def __getattr__(name: str) -> Any:
    """The class that qpbenchmark asks this module for."""
    if name == CLASS:
        return _test_set_class()
    raise AttributeError(name)
