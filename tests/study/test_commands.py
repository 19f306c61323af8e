"""Commands write into a study and read from it; nothing twice, nothing of one person under another."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from rehab_opt.cli import main
from rehab_opt.measures import score
from rehab_opt.measures.score import Measure
from rehab_opt.recordings.tables import read_csv
from rehab_opt.study.record import metric_trials
from rehab_opt.study.store import Study
from rehab_opt.study.summary import interval, quantity, session_means, trend
from rehab_opt.study.trial import Session, Trial
from tests.measures.yardstick import reach
from tests.study.made_studies import made_folders

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Exit code, output and errors of `rehab-opt` in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def called(*words: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as done:
            main([*words])
        printed = capsys.readouterr()
        return int(done.value.code or 0), printed.out, printed.err

    return called


def recording(path: Path, size: float = 1.0) -> str:
    time, points = reach(100, rest=0.3)
    rows = "\n".join(f"{t:.6f},{size * x:.9f},{y + 0.01 * t:.9f}" for t, (x, y) in zip(time, points, strict=True))
    path.write_text(f"t_s,x_m,y_m\n{rows}\n")
    return str(path)


def into(person: str, session: str, *covariates: str) -> list[str]:
    said = [word for each in covariates for word in ("--covariate", each)]
    return ["--study", "s", "--person", person, "--session", session, *said]


def test_a_command_that_fails_leaves_nobody_in_the_study(run: Run) -> None:
    assert run("score", "none.csv", *into("P1", "week 1"))[0] == 2
    with Study(Path("s")) as study:
        assert study.rows("SELECT person FROM sessions") == []


def test_scores_of_real_trials_go_into_the_study_once(run: Run, tmp_path: Path) -> None:
    files = [recording(tmp_path / "a.csv"), recording(tmp_path / "b.csv", 0.9)]
    words = ["score", *files, *into("P1", "week 1", "group=stroke", "condition=assisted", "visit=1", "date=2026-11-23")]
    code, out, err = run(*words)
    assert (code, out.splitlines()[0]) == (0, "recording,trial,measure,value,unit")
    assert "2 trials into s: P1, week 1" in err
    assert "0 trials into s: P1, week 1 (the study has them already)" in run(*words)[2]
    with Study(tmp_path / "s") as study:
        read = read_csv(Path(files[0]), name="a")
        expected = {(each.name, each.unit): each.value for each in score(read.time, read.points).measures}
        found = study.rows(
            "SELECT q.name, q.unit, m.value FROM measures m JOIN quantities q ON q.id = m.quantity WHERE m.trial = 1"
        )
        assert {(name, unit): value for name, unit, value in found} == pytest.approx(expected)
        assert study.rows("SELECT number, kind, condition, status FROM trials") == [
            (1, "score", "assisted", "done"),
            (2, "score", "assisted", "done"),
        ]
        kept = [json.loads((tmp_path / "s" / "P1" / "week 1" / f"00{i}" / "trial.json").read_text()) for i in (1, 2)]
        assert [each["files"] for each in kept] == [[[file, "recording"]] for file in files]
        corners = np.array(json.loads(study.rows("SELECT points FROM outlines")[0][0]))
        assert np.ptp(corners[:, 0]) == pytest.approx(0.2, rel=0.02)
    assert run("study", "remove", "s", "--person", "P1", "--yes")[1].count("a recording of theirs stays") == 2


def test_the_same_recording_measured_otherwise_is_another_trial(run: Run, tmp_path: Path) -> None:
    words = ["score", recording(tmp_path / "a.csv"), *into("P1", "1")]
    assert "1 trial into" in run(*words)[2]
    assert "1 trial into" in run(*words, "--cutoff", "8")[2]
    assert "0 trials into" in run(*words, "--cutoff", "8")[2]
    recording(tmp_path / "a.csv", 0.5)
    assert "1 trial into" in run(*words)[2]


def test_a_run_goes_in_with_problem_and_trace_and_both_leave_with_the_person(run: Run, tmp_path: Path) -> None:
    problem = tmp_path / "p.toml"
    problem.write_text(
        'system = "workspace"\ntitle = "w"\n[arm]\nside = "left"\nrange_of_motion = "restricted"\naccuracy_mm = 5.0\n'
    )
    code, out, _ = run("run", "p.toml", *into("P1", "1"))
    assert (code, "1 trial into s: P1, 1" in out) == (0, True)
    with Study(tmp_path / "s") as study:
        kept = json.loads((tmp_path / "s" / "P1" / "1" / "001" / "trial.json").read_text())
        assert kept["problem"] == ["p", problem.read_text()]
        for name in ("metrics.json", "trace.csv"):
            assert (tmp_path / "s" / "P1" / "1" / "001" / name).read_bytes() == (
                tmp_path / "out" / "p" / name
            ).read_bytes()
        metrics = json.loads((tmp_path / "out" / "p" / "metrics.json").read_text())["metrics"]
        area = quantity(study, "sets.restricted.area")
        assert session_means(study, [area])[area][0].mean == metrics["sets"]["restricted"]["area_m2"]
        assert area.unit == "m^2"
    run("study", "remove", "s", "--person", "P1", "--yes")
    assert not (tmp_path / "out" / "p").exists()
    assert problem.exists()


def test_what_does_not_say_whose_trial_it_is_is_refused_before_anything_is_done(run: Run, tmp_path: Path) -> None:
    file = recording(tmp_path / "a.csv")
    for words, named in (
        (["--study", "s"], "--person"),
        (["--study", "s", "--person", "P"], "--session"),
        (["--person", "P"], "--study"),
        ([*into("P", "1"), "--covariate", "age=3"], "group, condition, visit, date"),
        (into("P", "1", "visit=1", "visit=2"), "each once"),
        (into("P", "1", "visit=first"), "visit"),
        (into("P", "1", "date=today"), "date"),
        (into("P", "1", "condition= \x1b"), "condition"),
    ):
        code, out, err = run("score", file, *words)
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert named in err
        assert not (tmp_path / "s").exists()


def test_people_are_listed_shown_and_compared(run: Run, tmp_path: Path) -> None:
    with Study(tmp_path / "s") as study:
        for person, group, gain in (("A", "g", 1.0), ("B", "g", 3.0), ("C", "h", 0.0)):
            for visit in (2, 1, 3):
                trials = [Trial("live", [Measure("time", 10 - gain * visit + e, "s")]) for e in (-1, 1)]
                study.add(Session(person, f"v{visit}", group=group, visit=visit), trials)
        study.add(Session("A", "v3"), Trial("live", [Measure("time", 99.0, "s")], status="failed", error="x"))
    assert run("study", "list", "s")[1].splitlines()[0] == "A  g  3 sessions  7 trials  -"
    shown = run("study", "show", "s")[1]
    assert "3 people, 9 sessions, 19 trials" in shown
    assert "1 trials are not done" in shown
    person = run("study", "show", "s", "--person", "A")[1]
    assert person.index("v1") < person.index("v2") < person.index("v3")
    assert "9 (-3.706 to" in person  # 8 and 10: 9 +- 12.706
    compared = run("study", "compare", "s", "--measure", "time")[1]
    assert "6 (-19.41 to" in compared  # of the people's means 8 and 4
    assert "-2 (-14.71 to" in compared  # of the slopes -1 and -3
    for words in (["show", "s", "--person", "X"], ["compare", "s", "--measure", "tme"], ["show", "absent"]):
        assert run("study", *words)[0] == 2
    assert "time" in run("study", "compare", "s", "--measure", "tme")[2]
    assert not (tmp_path / "absent").exists()
    name = "x');DROP--TABLE--people;--"
    with Study(tmp_path / "s") as study:
        study.add(Session(name, name, group=name), Trial("live", [Measure(name, 1.0, name)], condition=name))
        assert (name,) in study.rows("SELECT person FROM sessions")


def test_intervals_and_slopes_are_those_of_scipy() -> None:
    rng = np.random.default_rng(5)
    for n in (2, 3, 10, 200):
        values = rng.normal(1e6, 2.0, n)
        found = interval(values.tolist())
        low, high = stats.t.interval(0.95, n - 1, values.mean(), stats.sem(values))
        assert (found.mean, found.n) == (pytest.approx(values.mean(), rel=1e-12), n)
        assert found.upper - found.lower == pytest.approx(high - low, rel=1e-6)
        line = stats.linregress(np.arange(n), values) if n > 2 else None
        if line is not None:
            half = stats.t.ppf(0.975, n - 2) * line.stderr
            assert trend(values.tolist())[:3] == pytest.approx(
                (line.slope, line.slope - half, line.slope + half), abs=1e-9
            )
    assert math.isnan(interval([1.0]).lower)


def test_everybody_of_folders_that_no_code_of_ours_wrote_is_compared(run: Run, tmp_path: Path) -> None:
    means = made_folders(tmp_path / "s", 6, 3, 4)
    table = run("study", "compare", "s", "--measure", "movement_time")[1].splitlines()
    for group, mean in means.items():
        rows = [row for row in table if f" {group} " in row]
        assert [row.split("\u2502")[2].strip() for row in rows] == ["assisted", "unassisted"]
        found = [float(row.split("\u2502")[4].split("(")[0]) for row in rows]
        assert np.mean(found) == pytest.approx(mean, abs=1e-3)
    assert "6 people, 18 sessions, 72 trials, 2026-01-05 to 2026-01-19" in run("study", "show", "s")[1]
    assert run("report", "s")[0] == 0
    Path("s/P0001/week 1/002/trial.json").write_text("{")
    Path("s/index.db").unlink()
    code, out, err = run("study", "show", "s")
    assert (code, "71 trials" in out, "not read: P0001/week 1/002: trial.json" in err) == (0, True, True)


def test_numbers_of_a_run_keep_units_bounds_and_events() -> None:
    law = {
        "trials": [
            {"force_commanded_max_N": 12.0, "speed_mean_m_s": 0.1, "status_fraction": {"ok": 0.75, "released": 0.25},
             "releases": 2, "time_to_target_s": None, "success": True},
        ]
    }  # fmt: skip
    metrics = {"laws": {"assisted": law, "published": law}, "parameters": {"assistance": {"force_limit_N": 10.0}}}
    trials = metric_trials(metrics, Trial("run", digest="d"))
    assert [(trial.condition, trial.digest) for trial in trials] == [
        ("assisted", "d assisted 1"),
        ("published", "d published 1"),
    ]
    assert set(trials[0].measures) == {
        Measure("force_commanded_max", 12.0, "N"),
        Measure("speed_mean", 0.1, "m/s"),
        Measure("releases", 2.0, ""),
        Measure("success", 1.0, ""),
    }
    assert trials[0].bounds == [("force_commanded", 12.0, 10.0, "N")]
    assert trials[0].events == [("released", 25.0, "% of ticks"), ("force let go", 2, "times")]
    flat = {
        "tilt_max_deg": 1.0,
        "tilt_limit_deg": 2.0,
        "speed_max_fraction_of_limit": 0.5,
        "status": {"ok": 9, "backup": 1},
    }
    (one,) = metric_trials({"optimised": flat}, Trial("run"))
    assert one.bounds == [("optimised.tilt", 1.0, 2.0, "deg"), ("optimised.speed", 0.5, 1.0, "of the limit")]
    assert one.events == [("optimised: backup", 1, "ticks")]


@pytest.mark.parametrize("option", ["--out", "--pdf"])
def test_a_report_is_never_written_over_its_study(run: Run, option: str) -> None:
    Study(Path("s")).close()
    for place in ("./s", "s/index.db", "s/study.json"):
        before = Path("s/study.json").read_bytes()
        code, _, error = run("report", "s", option, place)
        assert (code, "--out" in error or "--pdf" in error) == (2, True)
        assert Path("s/study.json").read_bytes() == before


def test_an_export_closes_a_folder_that_was_open_to_others(run: Run, tmp_path: Path) -> None:
    Study(Path("s")).close()
    (tmp_path / "shared").mkdir(mode=0o755)
    assert run("study", "export", "s", "--out", "shared")[0] == 0
    assert (tmp_path / "shared").stat().st_mode & 0o777 == 0o700
