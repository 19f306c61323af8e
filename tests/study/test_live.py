"""A live session's trials, from pictures whose numbers are known."""

from __future__ import annotations

import numpy as np
import pytest

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.score import score
from rehab_opt.session.live.problem import Seen
from rehab_opt.study.live import LiveTrials
from rehab_opt.study.options import Destination
from rehab_opt.study.store import Study
from rehab_opt.study.trial import ProblemText, Session
from tests.measures.yardstick import reach

PLOTS = [{"name": "force", "unit": "N", "line": 10.0}, {"name": "away", "unit": "mm", "least": 5.0}]


def test_each_time_the_switch_is_held_is_a_trial(tmp_path) -> None:
    time, points = reach(30, rest=0.3)
    points[:, 1] += 0.02 * np.sin(3 * points[:, 0] / np.ptp(points[:, 0]))
    into = Destination(tmp_path / "s", Session("P", "1"), "free")
    trials = LiveTrials(into, ProblemText("p", "text"))
    trials.begin(PLOTS)
    at = 5.0

    def held(count: int, *, hand: bool = True, status: str = "ok", missed: int = 0) -> None:
        nonlocal at
        for k in range(count):
            where = (*points[k % len(points)].tolist(), 0.0) if hand else None
            now = status if k == count - 1 else "ok"
            trials.see(Seen(at + time[k % len(time)], True, now, "" if now == "ok" else "because", missed * (k > 3), 0,
                            where, (float(k % 12), np.nan if k else 2.0)))  # fmt: skip
        at += 10.0
        trials.see(Seen(at, False, "blocked", "", 0, 0, None, (50.0, 50.0)))

    n = len(time)
    held(n)
    held(10)  # a third of a second
    held(n, hand=False, status="safe", missed=7)
    assert trials.written == 2
    with Study(into.folder) as study:
        measures = {
            (trial, name): (value, unit)
            for trial, name, value, unit in study.rows(
                "SELECT m.trial, q.name, m.value, q.unit FROM measures m JOIN quantities q ON q.id = m.quantity"
            )
        }
        expected = score(time - time[0], np.column_stack([points, np.zeros(n)]))
        for each in expected.measures:
            if np.isfinite(each.value):
                assert measures[1, each.name] == (pytest.approx(each.value, rel=1e-3), each.unit)
            assert (2, each.name) not in measures
        assert measures[1, "held"] == (pytest.approx(time[-1] - time[0]), "s")
        assert measures[2, "force, largest"] == (11.0, "N")
        assert measures[2, "away, mean"] == (2.0, "mm")
        assert study.rows("SELECT trial, name, value, bound, unit FROM bounds") == [
            (1, "force", 11.0, 10.0, "N"),
            (2, "force", 11.0, 10.0, "N"),
        ]
        assert study.rows("SELECT trial, text, times, unit FROM events ORDER BY rowid") == [
            (2, "safe: because", 1, "pictures"),
            (2, "ticks left out", 7, "ticks"),
        ]
        assert study.rows("SELECT condition, kind FROM trials") == [("free", "live")] * 2
        assert study.rows("SELECT trial FROM outlines") == [(1,)]


def test_a_trial_that_cannot_be_written_is_told(tmp_path) -> None:
    file = tmp_path / "s"
    trials = LiveTrials(Destination(file, Session("P", "1"), None), ProblemText("p", "text"))
    for k in range(60):
        trials.see(Seen(k / 30, True, "ok", "", 0, 0, None, ()))
    file.write_text("another program's")
    with pytest.raises(ConfigurationError, match="study"):
        trials.end()
