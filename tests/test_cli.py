"""The command line as a user meets it: results where asked for, one line and exit code 2 for everything unusable."""

from __future__ import annotations

import csv
import inspect
import json
import os
import re
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path

import casadi
import pytest

import rehab_opt
from rehab_opt.cli import app, main
from rehab_opt.recordings.data_folder import ENVIRONMENT
from rehab_opt.session.files import shipped_problems
from rehab_opt.session.keys import keys_of
from rehab_opt.session.robot_file import RobotFile
from rehab_opt.session.systems import system_named
from rehab_opt.terminal import bars, brief
from tests.golden import assert_kept

PROBLEM = """
system = "upper_limb"
title = "short path"
[arm]
side = "left"
range_of_motion = "restricted"
[recording]
file = "path.csv"
hand = "left"
[placement]
centre_m = [-0.172, 0.502]
[run]
rate_hz = 20.0
"""
CSV = "t_s,x_m,y_m\n0,0,0\n0.5,0.01,0\n1.0,0.01,0.01\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own folder with a sound problem and its path, to work in."""
    (tmp_path / "problem.toml").write_text(PROBLEM, encoding="utf-8")
    (tmp_path / "path.csv").write_text(CSV, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are written without what is in them, which takes most of a run's time."""
    monkeypatch.setattr("matplotlib.figure.Figure.draw", lambda *_: None)


def ended(*arguments: str) -> int:
    """Exit code of the command."""
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    return int(end.value.code or 0)


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def change(folder: Path, old: str, new: str) -> None:
    assert old in PROBLEM
    (folder / "problem.toml").write_text(PROBLEM.replace(old, new), encoding="utf-8")


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended("--version") == 0
    assert capsys.readouterr().out == f"rehab-opt {rehab_opt.__version__}\n"


@pytest.mark.parametrize("system", ["mirror", "robot"])
def test_every_key_of_a_system_is_said_whole(
    system: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert ended("keys", system) == 0
    said = capsys.readouterr().out
    schema = RobotFile if system == "robot" else system_named(system).schema
    words = set(said.split())
    for each in keys_of(schema):
        assert {key.rpartition(".")[2] for key, *_ in each.rows} <= words
    assert not re.search(r"[`*]|\\n|None", said)
    assert max(map(len, (line for line in said.splitlines() if line.startswith("  ")))) <= 80


def test_unusable_option_is_one_line_and_exit_code_2(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "people.csv").write_text(PEOPLE, encoding="utf-8")
    (folder / "nobodys.csv").write_text("participant,arm.sied\nanna,left\n", encoding="utf-8")
    before = files(folder)
    for arguments, named in (
        (("run", "problem.toml", "--law", "fastest"), "published, optimised or both"),
        (("run", "problem.toml", "--solver", "scpgen"), "--solver = 'scpgen'"),
        (("run", "problem.toml", "--law", "published", "--solver", "sqp"), "--solver = 'sqp'"),
        (("run", "problem.toml", "--out", "path.csv"), "a folder that can be written to"),
        (("many", "nobody"), "nobody: file = 'not found'"),
        (("many", "people.csv", "--workers", "0"), "--workers = 0"),
        (("many", "nobodys.csv"), "nobodys.csv, line 2: arm.sied = 'left': expected one of the keys"),
        (("many", ".", "--problem", "range.toml"), "--problem = 'range.toml': expected no such option with a folder"),
    ):
        assert ended(*arguments) == 2
        printed = capsys.readouterr().err
        assert printed.count("\n") == 1
        assert named in printed
        assert len(printed) < 400
        assert files(folder) == before


def test_without_a_terminal_progress_is_a_line_a_minute(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr("rehab_opt.terminal.time.monotonic", lambda: clock[0])
    with bars() as progress:
        for second in range(150):
            clock[0] = float(second)
            progress("following the circle", second, 150)
    assert capsys.readouterr().err.splitlines() == [
        "rehab-opt: following the circle, 60 of 150, about 2 min left",
        "rehab-opt: following the circle, 120 of 150, about 1 min left",
    ]


def test_run_writes_numbers_trace_and_figures(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended("run", "problem.toml", "--out", "result") == 0
    figures = {f"{name}.{suffix}" for name in ("hand_path", "joints", "error") for suffix in ("png", "pdf")}
    assert files(folder / "result") == {"metrics.json", "trace.csv", "captions.md", *figures}
    content = json.loads((folder / "result/metrics.json").read_text(encoding="utf-8"))
    assert {"optimised", "published"} <= content["metrics"].keys()
    assert content["metrics"]["reachable_fraction_of_length"] == 1.0
    assert content["metrics"]["optimised"]["position_error_max_m"] < 1e-6
    with (folder / "result/trace.csv").open(encoding="utf-8") as trace:
        rows = list(csv.DictReader(trace))
    assert len(rows) == content["metrics"]["samples"] == 21
    assert float(rows[-1]["path_x_m"]) == pytest.approx(-0.167)
    assert all((folder / f"result/{name}.png").read_bytes().startswith(b"\x89PNG") for name in ("joints", "error"))
    printed = capsys.readouterr()
    assert "within this arm's reach: 100.0 %" in printed.out
    assert printed.err == ""
    assert "solve time" not in printed.out
    assert "more numbers: --all" in printed.out
    (recording,) = (each for each in folder.glob("*.csv"))
    assert content["inputs"] == {
        "problem": {"file": "problem.toml", "sha256": sha256((folder / "problem.toml").read_bytes()).hexdigest()},
        "recording.file": {"file": recording.name, "sha256": sha256(recording.read_bytes()).hexdigest()},
    }
    assert abs(datetime.fromisoformat(content["date"]) - datetime.now(UTC)) < timedelta(minutes=5)
    assert content["software"]["casadi"] == casadi.__version__


@pytest.mark.usefixtures("undrawn")
def test_one_law_alone_can_be_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    law = "optimised"
    assert ended("run", "problem.toml", "--law", law, "--all") == 0
    said = capsys.readouterr().out
    assert all(each in said for each in ("driven: followed within 1 mm", "solve time first, ms", "│ status"))
    assert "--all" not in said
    content = json.loads((folder / "out/problem/metrics.json").read_text(encoding="utf-8"))
    metrics = content["metrics"]
    assert content["options"] == {"law": law}
    assert {"published", "optimised"} & metrics.keys() == {law}
    assert metrics["reachable_fraction_of_length"] == 1.0


@pytest.mark.usefixtures("undrawn")
def test_second_run_gets_a_number_or_replaces_its_files_and_leaves_others(folder: Path) -> None:
    kept = folder / "result" / "notes.txt"
    kept.parent.mkdir()
    kept.write_text("mine", encoding="utf-8")
    arguments = ("run", "problem.toml", "--law", "published", "--out", "result")
    assert ended(*arguments) == 0
    first = (folder / "result/metrics.json").read_bytes()
    assert ended(*arguments) == 0
    assert (folder / "result/metrics.json").read_bytes() == first
    assert {"metrics.json", "joints.png", "joints.pdf"} <= files(folder / "result-2")
    assert ended(*arguments, "--force") == 0
    assert not (folder / "result-3").exists()
    assert (folder / "result/metrics.json").read_bytes() != first  # solve times differ
    assert kept.read_text(encoding="utf-8") == "mine"
    assert not [name for name in files(folder) if Path(name).name.startswith(".")]


def test_list_names_every_problem_and_whether_its_data_is_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(ENVIRONMENT, str(folder))
    monkeypatch.setenv("COLUMNS", "200")
    assert ended("list") == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in shipped_problems())
    assert "absent: data:pen_trace/signal.svc" in printed
    assert "none to fetch" in printed


def test_check_accepts_a_sound_problem_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files(folder)
    assert ended("check", "problem.toml") == 0
    assert capsys.readouterr().out.endswith("ok\n")
    assert files(folder) == before


def test_unusable_input_is_one_line_and_exit_code_2_and_nothing_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(ENVIRONMENT, str(folder / "nowhere"))
    for old, new, named in (
        ("side =", "colour = 1\nside =", "arm.colour"),
        ("path.csv", "none.csv", "recording.file = 'none.csv'"),
        ("path.csv", "data:pen_trace/signal.svc", ENVIRONMENT),
        ('hand = "left"', 'hand = "right"', "recording.mirror = False: expected true"),
        (
            "[placement]",
            'columns = ["a_m", "y_m"]\n[placement]',
            "recording.columns = 'a_m': expected columns of path.csv",
        ),
    ):
        change(folder, old, new)
        before = files(folder)
        assert ended("run", "problem.toml", "--out", "result") == 2
        printed = capsys.readouterr()
        assert (printed.out, printed.err.count("\n")) == ("", 1)
        assert named in printed.err
        assert files(folder) == before


RANGE = """
system = "workspace"
title = "small"
[arm]
side = "left"
range_of_motion = "restricted"
accuracy_mm = 10.0
"""
PEOPLE = "participant,arm.side,arm.segments.humerus_mm\nanna,right,290\nben,left,0.3\n"


@pytest.mark.usefixtures("undrawn")
def test_many_writes_a_folder_for_each_and_a_row_for_all_and_goes_on_where_it_was(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "range.toml").write_text(RANGE, encoding="utf-8")
    (folder / "people.csv").write_text(PEOPLE, encoding="utf-8")
    assert ended("many", "people.csv", "--problem", "range.toml", "--workers", "1") == 1
    printed = capsys.readouterr()
    assert "1 of 2 participants done" in [line.strip() for line in printed.out.splitlines()]
    assert "people.csv, line 3" in printed.out
    said = printed.err.splitlines()  # on a busy machine a line a minute
    assert all(line.startswith("rehab-opt: participants, ") for line in said)
    with (folder / "out/many/people/results.csv").open(encoding="utf-8") as results:
        rows = {row["participant"]: row for row in csv.DictReader(results)}
    assert (rows["anna"]["status"], rows["ben"]["status"]) == ("done", "refused")
    assert float(rows["anna"]["sets.restricted.area_m2"]) > 0.002
    assert rows["ben"]["error"].startswith("people.csv, line 3: arm.segments.humerus_mm = 0.3: expected 50 to 1000 mm")
    assert (folder / "out/many/people/anna/workspace.png").exists()
    assert ended("many", "people.csv", "--problem", "range.toml", "--workers", "1") == 1
    assert "1 of 2 participants done, 1 of them from an earlier run\n" in capsys.readouterr().out


@pytest.mark.skipif(os.name != "posix", reason="needs ulimit")
def test_a_file_that_does_not_fit_is_named_and_leaves_what_was_there(tmp_path: Path) -> None:
    samples = [f"{0.01 * i},{0.3 * (i / 200) ** 2 * (3 - i / 100)},0.1" for i in range(200)]
    (tmp_path / "a.csv").write_text("\n".join(["t_s,x_m,y_m", *samples]), encoding="utf-8")
    rows = tmp_path / "rows.csv"
    rows.write_text("of last year", encoding="utf-8")
    command = ["-m", "rehab_opt", "score", str(tmp_path / "a.csv"), "--out", str(rows), "--force"]
    full = ["sh", "-c", 'ulimit -f 0; exec "$@"', "sh", sys.executable, *command]
    done = subprocess.run(full, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == f"rehab-opt: {rows} = 'File too large': expected a place that can be read and written to\n"
    assert rows.read_text(encoding="utf-8") == "of last year"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.csv", "rows.csv"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_output_that_cannot_be_written_is_one_line_and_exit_code_2(folder: Path) -> None:
    command = [sys.executable, "-m", "rehab_opt", "--help"]
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, cwd=folder, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "No space left on device" in done.stderr


def test_processes_own_mistake_is_not_called_the_users(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("a mistake of ours")

    monkeypatch.setattr("rehab_opt.session.run.checked", broken)
    with pytest.raises(RuntimeError, match="of ours"):
        main(["check", "problem.toml"])


INTERRUPTED = """
import os, signal, sys
import rehab_opt.cli as cli
from rehab_opt.session import report
{patch}
cli.main(sys.argv[1:])
"""
NOW = "lambda *_, **__: os.kill(os.getpid(), signal.SIGINT)"
DURING_WRITING = f"""
whole = report.metrics_json
report.metrics_json = lambda outcome: [({NOW})(), whole(outcome)][1]
"""
SOLVING = f"""
from functools import cache
from threading import Timer
from rehab_opt.optim.nlp_solvers import NLPSolver
solve, begin = NLPSolver.solve, cache(lambda: Timer(0.3, {NOW}).start())
NLPSolver.solve = lambda *given: [begin(), solve(*given)][1]
"""


def test_interrupt_while_files_are_written_is_one_line_and_exit_code_130_and_leaves_all_files(folder: Path) -> None:
    arguments = ["run", "problem.toml", "--law", "published", "--out", "result"]
    program = [sys.executable, "-c", INTERRUPTED.format(patch=DURING_WRITING), *arguments]
    done = subprocess.run(program, capture_output=True, text=True, cwd=folder, check=False)
    assert (done.returncode, done.stderr) == (130, "rehab-opt: interrupted\n")
    present = files(folder)
    assert not [name for name in present if Path(name).name.startswith(".")]
    assert {"result/metrics.json", "result/error.png"} <= present


@pytest.mark.nightly
def test_interrupt_inside_a_solver_is_one_line_and_exit_code_130(folder: Path) -> None:
    change(folder, "rate_hz = 20.0", "rate_hz = 1000.0")
    (folder / "path.csv").write_text("t_s,x_m,y_m\n0,0,0\n60,0.05,0.05\n", encoding="utf-8")
    arguments = ["run", "problem.toml", "--solver", "ipopt", "--law", "optimised"]
    program = [sys.executable, "-c", INTERRUPTED.format(patch=SOLVING), *arguments]
    done = subprocess.run(program, stderr=subprocess.PIPE, text=True, cwd=folder, check=False)
    assert (done.returncode, done.stderr) == (130, "rehab-opt: interrupted\n")
    assert files(folder) == {"problem.toml", "path.csv"}


def test_defaults_of_the_commands_are_those_kept() -> None:
    of = {each.callback: inspect.signature(each.callback).parameters.values() for each in app.registered_commands}  # type: ignore[arg-type]
    assert_kept("cli", {each.__name__: {p.name: repr(p.default) for p in told} for each, told in of.items() if each})


def test_notes_on_a_robot_that_are_alike_are_one() -> None:
    alike = [
        f"joint finger_{i} is not between base and tip: body b{i} is taken where it is at first" for i in range(33)
    ]
    near = [f"link {name}, inertia: no body has it" for name in "ab"]
    others = ["published: 3 ticks braked", "published: 4 ticks braked", "published: 5 ticks braked"]
    assert brief([*alike, *near, *others]) == [f"{alike[0]} (and 32 more like this: --all)", *near, *others]
