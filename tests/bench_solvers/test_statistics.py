"""Numbers of many times, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from bench.solvers.judgement import Judged, Outcome
from bench.solvers.recommendation import recommendations
from bench.solvers.statistics import percentile, performance_profile, shifted_geometric_mean, tail
from bench.solvers.summary import Row, row_of
from bench.solvers.table import as_markdown, family_grids, refusal_grid, share_text


def test_the_shifted_geometric_mean_of_two_is_the_root_of_their_product_and_a_failure_counts_as_the_limit() -> None:
    assert shifted_geometric_mean([1.0, 7.0], limit=10.0, shift=1.0) == pytest.approx(np.sqrt(2.0 * 8.0) - 1.0)
    assert shifted_geometric_mean([1.0, np.inf], limit=7.0, shift=1.0) == pytest.approx(3.0)


def test_percentiles_are_times_that_were_measured() -> None:
    times = np.arange(1.0, 1001.0)
    assert [percentile(times, fraction) for fraction in (0.5, 0.99, 0.999, 1.0)] == [500.0, 990.0, 999.0, 1000.0]


@pytest.mark.parametrize(("fraction", "enough"), [(0.99, 100), (0.999, 1000)])
def test_of_too_few_solves_no_percentile_is_told(fraction: float, enough: int) -> None:
    times = np.arange(1.0, enough + 1.0)
    assert tail(times, fraction) == enough - 1
    assert np.isnan(tail(times[:-1], fraction))
    rows = [row_of("f", "s", "warm", [(judged(Outcome.SOLVED), False)] * n, limit=1.0) for n in (enough - 1, enough)]
    few, many = (as_markdown(family_grids([row])[0]) for row in rows)
    assert few.count(" - |") == many.count(" - |") + 1
    assert f"{enough} instances" in many


def test_the_profile_of_times_made_by_hand() -> None:
    profile = performance_profile({"a": [1.0, 2.0, np.inf, 4.0], "b": [2.0, 1.0, np.inf, np.inf]})
    assert profile["a"][0].tolist() == [1.0, 1.0, 2.0]
    assert profile["a"][1].tolist() == [0.25, 0.5, 0.75]
    assert profile["b"][0].tolist() == [1.0, 2.0]
    assert profile["b"][1].tolist() == [0.25, 0.5]


def judged(outcome: Outcome, seconds: float = 1e-5, distance: float = 1e-12) -> Judged:
    return Judged(outcome, seconds, 1e-12, distance)


def test_one_failure_in_many_is_never_rounded_to_all() -> None:
    assert [share_text(fraction) for fraction in (1.0, 0.99999, 0.145, 0.0)] == ["100 %", "99.99 %", "14.5 %", "0 %"]


def test_a_row_counts_what_became_of_each_tick() -> None:
    fair = [Outcome.SOLVED] * 5 + [
        Outcome.WRONG,
        Outcome.NO_ANSWER,
        Outcome.RAISED,
        Outcome.TOO_LATE,
        Outcome.NOT_TRIED,
    ]
    lost = [Outcome.SAID_NO, Outcome.CLAIMED, Outcome.TOO_LATE, Outcome.NOT_TRIED, Outcome.RAISED]
    ticks = [(judged(each), False) for each in fair] + [(judged(each), True) for each in lost]
    row = row_of("family", "solver", "warm", ticks, limit=1.0)
    assert (row.ticks, row.solved, set(row.failures.values())) == (10, 0.5, {1})
    assert (row.hopeless, row.said_no, row.claimed, row.hung, row.raised) == (5, 1, 1, 2, 1)
    assert (row.median, row.largest) == (1e-5, np.inf)
    text = as_markdown(family_grids([row])[0])
    assert "| solver | warm | 50 % | 1 wrong, 1 none, 1 late, 1 raised, 1 not tried | 10.0 | - | - | failed |" in text
    assert "| family | solver | warm | 5 | 1 | 1 | 2 | 1 | 10.0 | 10.0 |" in as_markdown(refusal_grid([row]))


def test_a_quicker_solver_that_fails_more_often_is_no_alternative() -> None:
    def row(solver: str, seconds: float, failures: int) -> Row:
        outcomes = [Outcome.SOLVED] * (10 - failures) + [Outcome.WRONG] * failures
        return row_of("f", solver, "warm", [(judged(each, seconds), False) for each in outcomes], limit=1.0)

    rows = [row("fallback", 3e-5, 0), row("rash", 1e-5, 1), row("daqp", 2e-5, 0), row("qrqp-virtual", 1e-6, 0)]
    (found,) = recommendations(rows)
    assert found.best is not None
    assert found.best.solver == "daqp"
    assert found.ratio == pytest.approx(1.5)
    assert not found.stays
