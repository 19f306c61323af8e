"""The table of ratios is read from the lines that the benches themselves judge by."""

from __future__ import annotations

import sys

import pytest

from bench.peers import pose_tracking, ratios
from bench.verdict import Reported, Verdict


@pytest.mark.parametrize("measured", [0.4, 0.6, 1e-12, float("nan")])
@pytest.mark.parametrize("what", ["free: ours / theirs", "share of theirs (worst: of 200)"])
def test_a_verdict_that_is_printed_is_read_again(what: str, measured: float) -> None:
    (read,) = ratios.ratios_in(f"a table\n{Verdict(what, measured, '<=', 0.5)}\n", "bench.some")
    assert (read.bench, read.what, read.asked) == ("bench.some", what, "<= 0.5")
    assert read.met is (measured <= 0.5)
    assert read.measured == pytest.approx(measured, nan_ok=True)


def test_a_ratio_of_which_nothing_was_asked_is_told_and_cannot_be_missed() -> None:
    (read,) = ratios.ratios_in(f"{Reported('free: ours / (mink + daqp)', 0.0421)}\n", "bench.some")
    assert read == ("bench.some", "free: ours / (mink + daqp)", "-", 0.0421, True)


def test_every_peer_of_a_pose_tracker_has_its_ratio() -> None:
    names = ("rehab_opt, compiled", "placo", "pink + daqp", "mink + daqp", "mink + quadprog", "roboticstoolbox + daqp")
    table = [pose_tracking.Row(name, 2.0**i, *[0.0] * 9) for i, name in enumerate(names)]
    told = {each.what: each.measured for each in pose_tracking.beside_others("free", table)}
    assert told == {
        "free: compiled / (mink + daqp)": 1 / 8,
        "free: compiled / (mink + quadprog)": 1 / 16,
        "free: compiled / (roboticstoolbox + daqp)": 1 / 32,
    }


def test_a_number_with_a_unit_is_no_ratio() -> None:
    assert ratios.ratios_in(str(Verdict("memory", 0.4, "<=", 0.5, "MB")), "bench.some") == []


def test_a_bench_that_cannot_run_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["ratios"])
    text, error = ratios._output("bench.no_such_bench", ())
    assert text == ""
    assert "no_such_bench" in error
