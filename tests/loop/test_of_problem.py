"""Problem files run in time, and run again from their logs, by the command."""

import json
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.cli import main
from rehab_opt.errors import ProblemFileError
from rehab_opt.loop.log_file import ABOUT, LogFile
from rehab_opt.loop.logged import Logged, read_log
from rehab_opt.loop.of_problem import files_of, replay_problem, run_in_time
from rehab_opt.loop.records import state_layout
from rehab_opt.session.files import load_problem
from tests.loop.clock import Clock

Writer = pytest.importorskip("mcap.writer").Writer

CIRCLE = "robot/ur5_circle"


def test_a_problem_is_run_in_time_and_again_from_its_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "logs" / "trace.mcap"
    main_ended(["loop", CIRCLE, "--seconds", "0.5", "--log", str(path)], 0)
    said = capsys.readouterr().out
    assert "ended: 0.5 s have passed" in said
    assert "scheduling: SCHED_OTHER" in said
    logged = read_log(path)
    assert logged.whole
    assert logged.about["problem"] == CIRCLE
    assert logged.files["problem.toml"] == load_problem(CIRCLE).path.read_bytes()
    main_ended(["replay", str(path)], 0)
    n = len(logged.records)
    assert f"{n} of {n} commands are equal" in capsys.readouterr().out

    kept = path.read_bytes()
    main_ended(["loop", CIRCLE, "--seconds", "0.5", "--log", str(path)], 2)  # another session's log
    assert f"--log = '{path}': expected a new file; this one exists" in capsys.readouterr().err
    assert path.read_bytes() == kept

    spoilt, at = logged.records.copy(), n // 2
    spoilt["command"][at, 1] += 1e-9
    rewritten(logged, spoilt, tmp_path / "spoilt.mcap")
    main_ended(["replay", str(tmp_path / "spoilt.mcap")], 1)
    said = capsys.readouterr().out
    assert f"first difference: tick {int(spoilt['tick'][at])}" in said
    assert "the command differs by 1e-09" in said


@pytest.mark.parametrize(
    "name",
    [
        "ardis/kinova_drink",
        "upper_limb/scenario_1_stretch",
        pytest.param("mirror/franka_pick_fruit", marks=pytest.mark.nightly),
    ],
)
def test_every_kind_that_is_live_is_run_in_time_and_again(name: str, tmp_path: Path, clock: Clock) -> None:
    """On a clock on which no machine is too busy for a tick."""
    path = tmp_path / "trace.mcap"
    report, lost = run_in_time(load_problem(name), seconds=0.3, log=path)
    logged = read_log(path)
    again = replay_problem(logged)
    assert (lost, again.first, again.same) == (0, "", len(logged.records))
    assert again.ticks == report.ticks > 10
    assert not (logged.records["status"] == b"holding").all()


def test_the_delay_of_a_problem_s_robot_is_told(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    main_ended(["delay", CIRCLE, "--plant", "mujoco", "--joint", "2"], 0)
    told = capsys.readouterr().out.split(": ")[1].split(" ms")[0]
    assert float(told) == pytest.approx(5.0, abs=1.5)
    main_ended(["delay", "upper_limb/scenario_1_stretch"], 2)
    assert "joint velocities" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("layout", ""), ("layout", "[[1"), ("names", "7"),
        ("layout", '[["record", "<f8", [1e9]]]'), ("layout", '[["a", "(2"]]'),
        ("layout", "[" * 100_000),
    ],
)  # fmt: skip
def test_a_log_whose_header_was_altered_is_refused_in_one_line(
    key: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    layout = state_layout(2)
    about = {"layout": json.dumps(layout.descr), "names": '["a", "b"]'} | {key: text}
    with (tmp_path / "trace.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata(ABOUT, about)
        writer.finish()
    main_ended(["replay", str(tmp_path / "trace.mcap")], 2)
    (line,) = capsys.readouterr().err.splitlines()
    assert "the log was altered" in line


def main_ended(arguments: list[str], code: int) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == code


def rewritten(logged: Logged, records: np.ndarray, path: Path) -> None:
    about = {name: value for name, value in logged.about.items() if name not in {"layout", "names"}}
    log = LogFile(path, records.dtype, names=logged.names, epoch=0, about=about, files=logged.files)
    log.write(records)
    log.finish()
    log.close()


def test_a_problem_with_a_robot_file_takes_its_files_along(tmp_path: Path) -> None:
    folder = load_problem(CIRCLE).path.parent.parent / "robots" / "kinova_gen3"
    text = load_problem(CIRCLE).path.read_text()
    text = text.replace('model = "ur5"', 'file = "gen3.toml"')
    text = text.replace(
        "start_deg = [0.0, -90.0, 90.0, -90.0, -90.0, 0.0]", "start_deg = [0, 15, 180, -130, 0, 55, 90]"
    )
    (tmp_path / "mine.toml").write_text(text)
    (tmp_path / "gen3.toml").write_text('urdf = "gen3.urdf"\ntip = "end_effector_link"\nacceleration_deg_s2 = 100\n')
    (tmp_path / "gen3.urdf").write_bytes((folder / "gen3.urdf").read_bytes())
    files = files_of(load_problem(str(tmp_path / "mine.toml")))
    assert set(files) == {"problem.toml", "gen3.toml", "gen3.urdf"}
    empty = np.zeros(0, dtype=state_layout(7))
    assert replay_problem(Logged(empty, (), {}, files, whole=True)).first == ""


@pytest.mark.parametrize("name", ["../outside.toml", "/tmp/outside.toml", "a/../../outside"])
def test_a_log_writes_no_file_outside_of_its_folder(name: str) -> None:
    files = {"problem.toml": b"", name: b"x"}
    with pytest.raises(ProblemFileError, match="attachment"):
        replay_problem(Logged(np.zeros(0, dtype=state_layout(6)), (), {}, files, whole=True))
