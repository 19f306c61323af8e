"""Every way in which a solver can fail is told apart, and costs nobody else an answer."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
import pytest

from bench.qp_recording.sequence import QPSequence
from bench.solvers import passes
from bench.solvers.entrant import Entrant
from bench.solvers.instances import RecordedQPs
from bench.solvers.judgement import Judge, Outcome
from bench.solvers.passes import Pass, Rules, passed
from bench.solvers.reference import references
from bench.solvers.worker import Worker
from tests.bench_solvers.fake_solvers import (
    SLEEP,
    TRAP,
    Gullible,
    Talkative,
    Wary,
    boxes,
    entrant,
    exact,
    unmakeable,
)

RULES = Rules(limit=0.3, repeats=2)
S = Outcome.SOLVED


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    made = Worker()
    yield made
    made.stop()


def run(worker: Worker, who: Entrant, sequence: QPSequence, mode: str = "cold") -> Pass:
    recorded = RecordedQPs(sequence)
    judge = Judge(recorded, references(sequence), limit=RULES.limit)
    return passed(worker, who, recorded, mode=mode, judge=judge, rules=RULES)


@pytest.mark.parametrize(
    ("how", "outcome"),
    [
        ("lies", Outcome.WRONG),
        ("gives NaN", Outcome.WRONG),
        ("gives up", Outcome.NO_ANSWER),
        ("raises", Outcome.RAISED),
        ("dies", Outcome.RAISED),
        ("is modest", Outcome.SOLVED),
        ("is honest", Outcome.SOLVED),
    ],
)
def test_each_failure_has_its_own_name_and_concerns_its_own_tick(worker: Worker, how: str, outcome: Outcome) -> None:
    done = run(worker, entrant(how), boxes())
    assert [tick.outcome for tick in done.ticks] == [S, S, outcome, S, S, S]
    for tick in done.ticks:
        if tick.outcome is S:
            assert tick.residual <= 1e-8
            assert tick.distance <= 1e-9
            assert 0 < tick.seconds < RULES.limit
        else:
            assert math.isnan(tick.distance)


def test_a_solver_that_sleeps_is_killed_in_time_and_the_other_ticks_are_kept(worker: Worker) -> None:
    run(worker, entrant("is honest"), boxes())  # the process is there, so that its start is not measured
    began = time.monotonic()
    done = run(worker, entrant("sleeps"), boxes(), "warm")
    assert time.monotonic() - began < SLEEP / 2
    assert [tick.outcome for tick in done.ticks] == [S, S, Outcome.TOO_LATE, S, S, S]
    assert done.ticks[TRAP].seconds == RULES.limit


@pytest.mark.parametrize(
    ("how", "outcome"), [("dies", Outcome.RAISED), ("sleeps", Outcome.TOO_LATE), ("lies", Outcome.WRONG)]
)
def test_a_failure_in_the_first_tick_concerns_that_tick_alone(
    worker: Worker, monkeypatch: pytest.MonkeyPatch, how: str, outcome: Outcome
) -> None:
    """The first solve, which is not timed, is of such a tick: what it dies of there is no failure of all others."""
    monkeypatch.setattr(passes, "FIRST_SECONDS", 0.8)
    done = run(worker, entrant(f"{how} at 0"), boxes())
    assert [tick.outcome for tick in done.ticks] == [outcome, S, S, S, S, S]


def test_only_the_solve_itself_counts_against_the_limit(worker: Worker) -> None:
    """What the comparison does around it takes 0.1 s here, the limit is half of that."""
    strict = RULES._replace(limit=0.05)
    recorded, known = RecordedQPs(boxes(3)), references(boxes(3))
    judge = Judge(recorded, known, limit=strict.limit)
    slow, late = (
        passed(worker, who, recorded, mode="cold", judge=judge, rules=strict)
        for who in (Entrant("talkative", Talkative, ""), entrant("dawdles"))
    )
    assert [tick.outcome for tick in slow.ticks] == [S] * 3
    assert [tick.outcome for tick in late.ticks] == [S, S, Outcome.TOO_LATE]


def test_a_solver_that_cannot_be_made_says_why(worker: Worker) -> None:
    done = run(worker, Entrant("never", unmakeable, "it needs more rows"), boxes())
    assert {tick.outcome for tick in done.ticks} == {Outcome.RAISED}
    assert done.ticks[0].said == "ValueError: it needs more rows"


def test_on_instances_without_an_answer_only_a_no_is_right(worker: Worker) -> None:
    sequence = boxes(marks=((), ("nan",), (), ("infeasible",), (), ()))
    careful, naive = run(worker, Entrant("wary", Wary), sequence), run(worker, Entrant("gullible", Gullible), sequence)
    assert [careful.ticks[i].outcome for i in (1, 3)] == [Outcome.SAID_NO] * 2
    assert [naive.ticks[i].outcome for i in (1, 3)] == [Outcome.CLAIMED] * 2
    assert [careful.ticks[i].outcome for i in (0, 2, 4, 5)] == [S] * 4
    assert {naive.ticks[i].outcome for i in (0, 2, 4, 5)} == {Outcome.WRONG}


def test_one_that_hangs_again_and_again_is_not_tried_for_ever(worker: Worker) -> None:
    sequence = boxes(marks=((), ("nan",), ("nan",), ("nan",), ("nan",), ("nan",)))
    done = run(worker, Entrant("wary", Wary, "sleeps"), sequence)
    assert [tick.outcome for tick in done.ticks] == [S, *[Outcome.TOO_LATE] * 3, *[Outcome.NOT_TRIED] * 2]


def test_the_reference_is_the_closed_form() -> None:
    sequence = boxes(50)
    for qp, known in zip(sequence, references(sequence), strict=True):
        assert known.residual <= 1e-10
        assert np.abs(known.x - exact(qp).x).max() <= 1e-12
