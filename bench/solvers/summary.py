"""The passes of a comparison in numbers: for every family, solver and mode one row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.solvers.judgement import Judged, Outcome
from bench.solvers.passes import Pass
from bench.solvers.statistics import percentile, shifted_geometric_mean, tail

__all__ = ["FAILURES", "Row", "comparable", "family_of", "family_times", "row_of", "rows_of", "times_of"]

FAILURES = (Outcome.WRONG, Outcome.NO_ANSWER, Outcome.TOO_LATE, Outcome.RAISED, Outcome.NOT_TRIED)
HOPELESS = (Outcome.SAID_NO, Outcome.CLAIMED)


class Row(NamedTuple):
    """One solver on one family. Times in seconds; what failed took infinitely long."""

    family: str
    solver: str
    mode: str
    ticks: int
    """Instances that have an answer."""
    solved: float
    """Share of them."""
    failures: dict[str, int]
    """How many of each kind."""
    median: float
    p99: float
    """NaN for less than 100 instances, p999 for less than 1000: that would be the largest."""
    p999: float
    largest: float
    mean: float
    """Shifted geometric, a failure counting as the time limit."""
    error: float
    """Median distance of the solved ones from the reference, NaN where there is none."""
    largest_error: float
    hopeless: int
    """Instances without an answer: infeasible, or with NaN."""
    said_no: int
    claimed: int
    hung: int
    """Killed at the limit, or not tried after several of those."""
    raised: int
    no_median: float
    """Median time to say no."""
    no_largest: float


def family_of(sequence: str) -> str:
    """What a sequence's name has before its stroke."""
    return sequence.partition("/")[0]


def comparable(passes: Sequence[Pass]) -> tuple[Pass, ...]:
    """The passes on those sequences that every solver of their family has been through, in each of its modes.

    Of a comparison that was interrupted, a family's last sequence may have been solved by some alone.
    """
    taking_part: dict[str, set[tuple[str, str]]] = {}
    done_by: dict[str, set[tuple[str, str]]] = {}
    for each in passes:
        taking_part.setdefault(family_of(each.sequence), set()).add((each.solver, each.mode))
        done_by.setdefault(each.sequence, set()).add((each.solver, each.mode))
    return tuple(each for each in passes if done_by[each.sequence] == taking_part[family_of(each.sequence)])


def rows_of(passes: Sequence[Pass], hopeless: dict[str, NDArray[np.bool_]], *, limit: float) -> tuple[Row, ...]:
    """A row for every family, solver and mode, in the order in which they first appear.

    Parameters
    ----------
    hopeless : (T,) of every sequence: which ticks have no answer.
    """
    groups: dict[tuple[str, str, str], list[Pass]] = {}
    for each in sorted(passes, key=lambda done: family_of(done.sequence)):
        groups.setdefault((family_of(each.sequence), each.solver, each.mode), []).append(each)
    return tuple(
        row_of(*names, [(tick, bool(bad)) for done in group for tick, bad in _marked(done, hopeless)], limit=limit)
        for names, group in groups.items()
    )


def row_of(family: str, solver: str, mode: str, ticks: Sequence[tuple[Judged, bool]], *, limit: float) -> Row:
    """The row of judged ticks, each with whether it has no answer."""
    fair, bad = [tick for tick, lost in ticks if not lost], [tick for tick, lost in ticks if lost]
    times = times_of(fair)
    errors = np.array([tick.distance for tick in fair if np.isfinite(tick.distance)])
    refusals = [tick.seconds for tick in bad if tick.outcome is Outcome.SAID_NO]
    count = {outcome: sum(tick.outcome is outcome for tick in bad) for outcome in Outcome}
    return Row(
        family, solver, mode,
        ticks=len(fair),
        solved=float(np.mean(np.isfinite(times))) if fair else float("nan"),
        failures={kind.value: sum(tick.outcome is kind for tick in fair) for kind in FAILURES},
        median=percentile(times, 0.5), p99=tail(times, 0.99), p999=tail(times, 0.999),
        largest=percentile(times, 1.0), mean=shifted_geometric_mean(times, limit=limit),
        error=float(np.median(errors)) if errors.size else float("nan"),
        largest_error=float(errors.max()) if errors.size else float("nan"),
        hopeless=len(bad), said_no=count[Outcome.SAID_NO], claimed=count[Outcome.CLAIMED],
        hung=count[Outcome.TOO_LATE] + count[Outcome.NOT_TRIED], raised=count[Outcome.RAISED],
        no_median=percentile(refusals, 0.5), no_largest=percentile(refusals, 1.0),
    )  # fmt: skip


def family_times(
    passes: Sequence[Pass], hopeless: dict[str, NDArray[np.bool_]], *, family: str, mode: str
) -> dict[str, NDArray[np.float64]]:
    """(N,) [s] of each solver on every instance of a family that has an answer; none of a solver that is not done."""
    own = [done for done in passes if family_of(done.sequence) == family and done.mode == mode]
    sequences = sorted({done.sequence for done in own})
    found = {}
    for solver in dict.fromkeys(done.solver for done in own):
        by_name = {done.sequence: done for done in own if done.solver == solver}
        if set(by_name) == set(sequences):
            fair = [tick for name in sequences for tick, lost in _marked(by_name[name], hopeless) if not lost]
            found[solver] = times_of(fair)
    return {solver: times for solver, times in found.items() if times.size}


def times_of(ticks: Iterable[Judged]) -> NDArray[np.float64]:
    """(N,) [s] of each tick, infinite where it was not solved."""
    return np.array([tick.seconds if tick.outcome is Outcome.SOLVED else np.inf for tick in ticks], dtype=np.float64)


def _marked(done: Pass, hopeless: dict[str, NDArray[np.bool_]]) -> zip[tuple[Judged, bool]]:
    return zip(done.ticks, hopeless[done.sequence].tolist(), strict=True)
