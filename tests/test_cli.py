"""The command line as a user meets it: results where asked for, one line and exit code 2 for everything unusable."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path

import casadi
import pytest
import typer

import rehab_opt
from rehab_opt.cli import app, main
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.recordings.data_folder import ENVIRONMENT
from rehab_opt.session.files import shipped_problems
from rehab_opt.session.keys import keys_of
from rehab_opt.session.robot_file import RobotFile
from rehab_opt.session.systems import system_named
from rehab_opt.terminal import bars

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


@pytest.mark.parametrize("system", ["pose_tracking", "mirror", "ardis", "robot"])
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


@pytest.mark.parametrize("command", ["run", "list", "check", "record", "many", "bench", "export-c"])
def test_help_loses_no_unit_to_markup_and_is_at_most_80_columns_wide(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert ended(command, "--help") == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert " :" not in printed


def test_no_help_has_square_brackets_which_a_terminal_takes_for_markup() -> None:
    commands = [typer.main.get_command(app)]
    for command in commands:
        commands += getattr(command, "commands", {}).values()
        for text in (command.help, *(getattr(each, "help", None) for each in command.params)):
            assert "[" not in (text or ""), (command.name, text)
    assert len(commands) > 15


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
    assert files(folder / "result") == {"metrics.json", "trace.csv", "hand_path.png", "joints.png", "error.png"}
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
@pytest.mark.parametrize("law", ["published", "optimised"])
def test_one_law_alone_can_be_run(folder: Path, law: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended("run", "problem.toml", "--law", law, "--all") == 0
    said = capsys.readouterr().out
    assert said.index("samples by status") < said.index("solve time of the first sample")
    assert "--all" not in said
    content = json.loads((folder / "out/problem/metrics.json").read_text(encoding="utf-8"))
    metrics = content["metrics"]
    assert content["options"] == {"law": law}
    assert {"published", "optimised"} & metrics.keys() == {law}
    assert (metrics["reachable_fraction_of_length"] is None) == (law == "published")


@pytest.mark.usefixtures("undrawn")
def test_second_run_gets_a_number_or_replaces_its_files_and_leaves_others(folder: Path) -> None:
    kept = folder / "result" / "notes.txt"
    kept.parent.mkdir()
    kept.write_text("mine", encoding="utf-8")
    arguments = ("run", "problem.toml", "--law", "published", "--out", "result")
    assert ended(*arguments) == 0
    first = (folder / "result/metrics.json").read_bytes()
    assert ended(*arguments, "--also", "svg,pdf") == 0
    assert (folder / "result/metrics.json").read_bytes() == first
    assert {"metrics.json", "joints.png", "joints.svg", "joints.pdf"} <= files(folder / "result-2")
    assert ended(*arguments, "--force") == 0
    assert not (folder / "result-3").exists()
    assert (folder / "result/metrics.json").read_bytes() != first  # solve times differ
    assert kept.read_text(encoding="utf-8") == "mine"
    assert not [name for name in files(folder) if Path(name).name.startswith(".")]


@pytest.mark.usefixtures("undrawn")
def test_shipped_problem_runs_by_name_and_writes_below_out(folder: Path) -> None:
    assert ended("run", "robot/ur5_circle") == 0
    assert (folder / "out/robot/ur5_circle/tool_path.png").exists()


def test_list_names_every_problem_and_whether_its_data_is_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(ENVIRONMENT, str(folder))
    monkeypatch.setenv("COLUMNS", "200")
    assert ended("list") == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in shipped_problems())
    assert "absent: data:pen_trace/signal.svc" in printed
    assert "shipped" in printed


def test_check_accepts_a_sound_problem_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files(folder)
    assert ended("check", "problem.toml") == 0
    assert capsys.readouterr().out.endswith("ok\n")
    assert files(folder) == before


@pytest.mark.usefixtures("undrawn")
def test_what_is_all_out_of_reach_is_not_called_ok_by_check_and_runs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It can be run, so both say 0: how far the hand got is a result, not an error."""
    change(folder, "[-0.172, 0.502]", "[0.5, 0.502]")
    assert ended("check", "problem.toml") == 0
    assert capsys.readouterr().out.endswith("to be read and run, but not as it asks: see above\n")
    assert ended("run", "problem.toml") == 0
    assert (folder / "out" / "problem" / "metrics.json").is_file()


def spoil_limit(folder: Path) -> None:
    limits = "\n".join(f"{name}_deg = [30, 60]" for name in ARM_JOINTS).replace("wrist_flexion_deg = [30, 60]", WRONG)
    change(folder, 'range_of_motion = "restricted"', f"[arm.range_of_motion]\n{limits}")


def spoil_directory(folder: Path) -> None:
    (folder / "problem.toml").unlink()
    (folder / "problem.toml").mkdir()


def changed(old: str, new: str) -> Callable[[Path], None]:
    """Another problem file."""
    return lambda folder: change(folder, old, new)


def recorded_as(content: str | bytes) -> Callable[[Path], None]:
    """Another recording."""
    return lambda folder: (
        Path(folder / "path.csv").write_bytes(content if isinstance(content, bytes) else content.encode()) and None
    )


def without(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def holding(content: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / "problem.toml").write_bytes(content) and None


WRONG = "wrist_flexion_deg = [60, 30]"
SPOILS = {
    "arm.colour": changed("side =", "colour = 1\nside ="),
    "arm.range_of_motion.wrist_flexion_deg = [60, 30]": spoil_limit,
    "recording.file = 'path.csv'": without("path.csv"),
    ENVIRONMENT: changed("path.csv", "data:pen_trace/signal.svc"),
    "recording.mirror = False: expected true": changed('hand = "left"', 'hand = "right"'),
    "expected UTF-8 text": holding(bytes(range(256))),
    "a directory": spoil_directory,
    "are the times in seconds": recorded_as(CSV.replace("1.0,", "1000000,")),
    "problem.toml: recording.columns = 'a_m': expected columns of path.csv: t_s, x_m, y_m": changed(
        "[placement]", 'columns = ["a_m", "y_m"]\n[placement]'
    ),
}


@pytest.mark.parametrize("named", SPOILS)
def test_unusable_input_is_one_line_and_exit_code_2_and_nothing_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], named: str
) -> None:
    monkeypatch.setenv(ENVIRONMENT, str(folder / "nowhere"))
    SPOILS[named](folder)
    before = files(folder)
    assert ended("run", "problem.toml", "--out", "result") == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert named in printed.err
    assert "Traceback" not in printed.err
    assert printed.out == ""
    assert files(folder) == before


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--law", "fastest"), "published, optimised or both"),
        (("--solver", "scpgen"), "--solver = 'scpgen'"),
        (("--solver", ""), "--solver = ''"),
        (("--law", "published", "--solver", "sqp"), "--solver = 'sqp'"),
        (("--also", "jpg"), "one of pdf, svg"),
        (("--out", "path.csv"), "a folder that can be written to"),
    ],
)
def test_unusable_option_is_one_line_and_exit_code_2(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, str], named: str
) -> None:
    before = files(folder)
    assert ended("run", "problem.toml", *arguments) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert named in printed
    assert len(printed) < 400
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
    (folder / "people.csv").write_text(PEOPLE.replace("0.3", "310"), encoding="utf-8")
    assert ended("many", "people.csv", "--problem", "range.toml", "--workers", "1") == 0
    assert capsys.readouterr().out.startswith("2 of 2 participants done, 1 of them from an earlier run\n")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("nobody",), "nobody: file = 'not found'"),
        (("people.csv", "--workers", "0"), "--workers = 0"),
        (("nobodys.csv",), "nobodys.csv, line 2: arm.sied = 'left': expected one of the keys"),
        ((".", "--problem", "range.toml"), "--problem = 'range.toml': expected no such option with a folder"),
    ],
)
def test_unusable_people_are_one_line_and_exit_code_2(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], named: str
) -> None:
    (folder / "people.csv").write_text(PEOPLE, encoding="utf-8")
    (folder / "nobodys.csv").write_text("participant,arm.sied\nanna,left\n", encoding="utf-8")
    before = files(folder)
    assert ended("many", *arguments) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert named in printed.err
    assert files(folder) == before


@pytest.mark.nightly
def test_interrupted_many_is_one_line_and_exit_code_130_and_says_who_is_left(folder: Path) -> None:
    (folder / "range.toml").write_text(RANGE.replace("10.0", "0.02"), encoding="utf-8")
    (folder / "people.csv").write_text(PEOPLE.replace("0.3", "280"), encoding="utf-8")
    command = [sys.executable, "-m", "rehab_opt", "many", "people.csv", "--problem", "range.toml"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=folder, start_new_session=True) as process:
        for _ in range(1200):  # however slow the machine
            if (folder / "out/many/people").exists():
                break
            time.sleep(0.1)
        time.sleep(1.0)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to every process
        _, said = process.communicate(timeout=120)
    assert (process.returncode, said) == (130, "rehab-opt: interrupted\n")
    results = (folder / "out/many/people/results.csv").read_text(encoding="utf-8")
    assert results.count("not run,interrupted before it was done") == 2


def test_figure_that_cannot_be_written_leaves_the_folder_as_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    before = files(folder)
    assert ended("run", "problem.toml", "--law", "published", "--out", "result") == 2
    assert "No space left on device" in capsys.readouterr().err
    assert files(folder) == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("arguments", [("list",), ("--help",)])
def test_output_that_cannot_be_written_is_one_line_and_exit_code_2(folder: Path, arguments: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "rehab_opt", *arguments]
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, cwd=folder, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "No space left on device" in done.stderr


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


def test_processes_own_mistake_is_not_called_the_users(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("a mistake of ours")

    monkeypatch.setattr("rehab_opt.session.run.checked", broken)
    with pytest.raises(RuntimeError, match="of ours"):
        main(["check", "problem.toml"])


INTERRUPTED = """
import os, signal, sys
import rehab_opt.cli as cli
from rehab_opt.session import participant, report
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


@pytest.mark.parametrize(
    ("patch", "left"),
    [(f"participant.placed_path = {NOW}", set()), (DURING_WRITING, None)],
    ids=["running", "writing"],
)
def test_interrupt_is_one_line_and_exit_code_130_and_leaves_all_files_or_none(
    folder: Path, patch: str, left: set[str] | None
) -> None:
    arguments = ["run", "problem.toml", "--law", "published", "--out", "result"]
    program = [sys.executable, "-c", INTERRUPTED.format(patch=patch), *arguments]
    done = subprocess.run(program, capture_output=True, text=True, cwd=folder, check=False)
    assert (done.returncode, done.stderr) == (130, "rehab-opt: interrupted\n")
    present = files(folder)
    assert not [name for name in present if Path(name).name.startswith(".")]
    assert ("result" in present) == (left is None)
    if left is None:
        assert {"result/metrics.json", "result/error.png"} <= present


def test_interrupt_inside_a_solver_is_one_line_and_exit_code_130(folder: Path) -> None:
    change(folder, "rate_hz = 20.0", "rate_hz = 1000.0")
    (folder / "path.csv").write_text("t_s,x_m,y_m\n0,0,0\n60,0.05,0.05\n", encoding="utf-8")
    arguments = ["run", "problem.toml", "--solver", "ipopt", "--law", "optimised"]
    program = [sys.executable, "-c", INTERRUPTED.format(patch=SOLVING), *arguments]
    done = subprocess.run(program, stderr=subprocess.PIPE, text=True, cwd=folder, check=False)
    assert (done.returncode, done.stderr) == (130, "rehab-opt: interrupted\n")
    assert files(folder) == {"problem.toml", "path.csv"}
