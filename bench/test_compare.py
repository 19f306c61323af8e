"""What counts as slower."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench import compare
from bench.compare import Change, changes
from bench.corpus import Quality, along, quality, read
from bench.qp_recording.sequence import QPSequence
from bench.results import MANY, summarised, write_section
from bench.solvers import dense_qp
from bench.solvers.entrant import Entrant
from bench.solvers.entrants import entrants

BEFORE = {"pose/free": {"qrqp-fused": 0.10, "osqp-kept": 2.0}}


def test_a_ratio_worse_than_the_factor_fails_and_a_better_one_does_not() -> None:
    now = {"pose/free": {"qrqp-fused": 0.16, "osqp-kept": 2.9}}
    assert [each.worse(1.5) for each in changes(BEFORE, now)] == [True, False]
    assert [each.worse(1.7) for each in changes(BEFORE, now)] == [False, False]


def test_what_is_no_longer_measured_fails_and_what_is_new_does_not() -> None:
    now = {"pose/free": {"qrqp-fused": 0.10}, "mirror/new": {"qrqp-fused": 9.0}}
    found = {(each.sequence, each.solver): each.worse(1.5) for each in changes(BEFORE, now)}
    assert found == {
        ("pose/free", "qrqp-fused"): False,
        ("pose/free", "osqp-kept"): True,
        ("mirror/new", "qrqp-fused"): False,
    }


def test_what_became_quicker_by_certifying_less_fails() -> None:
    now = {"pose/free": {"qrqp-fused": 0.01, "osqp-kept": 2.0}}
    fractions = {"pose/free": {"qrqp-fused": 1.0, "osqp-kept": 0.98}}
    less = {"pose/free": {"qrqp-fused": 0.995, "osqp-kept": 0.98}}
    found = changes(BEFORE, now, certified_before=fractions, certified_now=less)
    assert [each.verdict(1.5) for each in found] == ["certifies 99.50%", ""]


class Clock:
    """Time that passes by what a solve is said to take, whatever else the machine does."""

    def __init__(self, ratios: Mapping[str, float]) -> None:
        self.now = 0.0
        self.seconds = {compare.REFERENCE: 1.0, **ratios}

    def perf_counter(self) -> float:
        return self.now

    def along(self, entrant: Entrant, sequence: QPSequence, *, ours: float) -> Callable[[], Any]:
        """Calls that take what the baseline says, and the watched solvers of ours a multiple of it."""
        call = along(entrant, sequence)
        seconds = self.seconds[entrant.name] * (ours if "qrqp" in entrant.name else 1.0)

        def timed() -> Any:
            self.now += seconds
            return call()

        return timed


def nothing_solved(self: dense_qp.DenseQP, data: Any, *, warm: bool) -> Any:
    return np.zeros(2 * self.n + self.m), math.nan


@pytest.mark.parametrize(("how", "verdict"), [("slow", "slower"), ("wrong", "certifies 0.00%"), ("same", "ok")])
def test_the_command_fails_where_a_solve_has_become_slower_or_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, how: str, verdict: str
) -> None:
    name, stored = "pose_tracking/free", json.loads(compare.BASELINE.read_text())
    file = tmp_path / "baseline.json"
    file.write_text(json.dumps({side: {name: stored[side][name]} for side in ("ratios", "certified")}))
    monkeypatch.setattr(compare, "BASELINE", file)
    clock = Clock(stored["ratios"][name])
    monkeypatch.setattr(compare, "time", clock)
    monkeypatch.setattr(compare, "along", partial(clock.along, ours=1.5 if how == "slow" else 1.0))
    if how == "wrong":
        monkeypatch.setattr(dense_qp.DenseQP, "solve", nothing_solved)
    monkeypatch.setattr(compare, "representatives", lambda: [name])
    assert compare.main(["--rounds", "1"]) == (how != "same")
    lines = [line for line in capsys.readouterr().out.splitlines() if name in line]
    assert len(lines) == len(compare.WATCHED)
    assert [verdict if "qrqp" in line else "ok" for line in lines] == [line.split("│")[-2].strip() for line in lines]


def test_a_solver_that_fails_has_no_certified_answer_and_a_large_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence, by_name = read("pose_tracking/free"), {each.name: each for each in entrants() if each.kind == "qp"}
    right = quality(by_name["qrqp-virtual"], sequence)
    assert right.certified == 1.0
    assert right.residual <= sequence.tolerance
    monkeypatch.setattr(dense_qp.DenseQP, "solve", nothing_solved)
    wrong = quality(by_name["qrqp-virtual"], sequence)
    assert wrong.certified == 0.0
    assert wrong.residual > 0.1
    assert Quality.of([1e-12, math.nan], 1e-8) == (0.5, math.inf)


def test_a_time_that_is_no_number_fails() -> None:
    assert Change("pose/free", "qrqp-fused", 0.1, math.nan).worse(1.5)


def test_a_section_of_the_results_is_put_at_the_end_and_later_replaced_where_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "RESULTS.md"
    file.write_text("# Results\n", encoding="utf-8")
    for name, line in (("spline", "one"), ("imports", "two"), ("spline", "three")):
        write_section(file, name, [line])
    assert file.read_text(encoding="utf-8") == (
        "# Results\n\n<!-- spline: begin -->\nthree\n<!-- spline: end -->\n\n"
        "<!-- imports: begin -->\ntwo\n<!-- imports: end -->\n"
    )


def test_every_miss_is_shown_and_passes_are_counted_with_those_nearest_to_their_bounds() -> None:
    passed = [f"PASS  number {k}: {k / 10} s (target <= 1 s)" for k in range(1, 10)]
    missed, note = "FAIL  another: 2 s (target <= 1 s)", "NOTE  a third: 4 (reported)"
    shown = summarised([passed[0], missed, *passed[1:], note])
    count = "PASS  9 numbers, of which these are nearest to their bounds:"
    assert shown == [missed, note, count, passed[8], passed[7]]
    few = [missed, *passed[:MANY], note]
    assert summarised(few) == few
