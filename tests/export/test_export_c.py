"""`rehab-opt export-c` as a user meets it."""

from __future__ import annotations

import errno
import os
import signal
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.cli import main
from rehab_opt.export.c_text import comment
from rehab_opt.export.exporters import EXPORTERS

NAMES = {"CMakeLists.txt", "README.md", "main.c", "recorded_run.csv", "recorded_run.h"}
ROBOT = """
system = "pose_tracking"
title = "short circle"
[robot]
model = "ur5"
start_deg = [0, -90, 90, -90, -90, 0]
[circle]
radius_m = 0.05
duration_s = 0.2
"""


def ended(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    return int(end.value.code or 0)


@settings(max_examples=50)
@given(text=st.text())
def test_a_comment_of_any_title_is_one_line_and_one_comment(text: str) -> None:
    whole = f"/* {comment(text)} */"
    assert whole.count("/*") == 1
    assert whole.index("*/") == len(whole) - 2
    assert len(whole.splitlines()) == 1
    assert "\\" not in whole


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    (tmp_path / "robot.toml").write_text(ROBOT)
    return tmp_path / "robot.toml"


def test_it_writes_every_file_and_says_how_to_build_them(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended("export-c", str(robot), str(tmp_path / "c")) == 0
    assert {path.name for path in (tmp_path / "c").iterdir()} == NAMES | {
        "rehab_pose_tracker.c",
        "rehab_pose_tracker.h",
    }
    assert "cmake -S" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"robot.toml", "c"}


def test_a_system_that_has_no_controller_in_c_is_refused_by_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended("export-c", "upper_limb/figure_eight", str(tmp_path / "c")) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "system = 'upper_limb'" in error
    assert ", ".join(EXPORTERS) in error
    assert not (tmp_path / "c").exists()


def test_a_solver_that_does_not_become_c_is_refused(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot.write_text(f'{ROBOT}[tracker]\nsolver = "proxqp"\n')
    assert ended("export-c", str(robot), str(tmp_path / "c")) == 2
    assert "tracker.solver = 'proxqp': expected qrqp" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


def test_a_mounted_folder_gets_its_files(robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mounted, move = tmp_path / "mounted", Path.replace
    mounted.mkdir()

    def on_one_device(draft: Path, target: Path) -> Path:
        if draft.is_relative_to(mounted) != target.is_relative_to(mounted):
            raise OSError(errno.EXDEV, "Invalid cross-device link", str(draft))
        return move(draft, target)

    monkeypatch.setattr(Path, "replace", on_one_device)
    assert ended("export-c", str(robot), str(mounted)) == 0
    assert {path.name for path in mounted.iterdir()} > NAMES
    assert not [path.name for path in mounted.iterdir() if path.name.startswith(".")]


def test_where_one_file_cannot_be_written_none_is(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c" / "README.md").mkdir(parents=True)
    assert ended("export-c", str(robot), str(tmp_path / "c")) == 2
    assert "README.md = 'Is a directory'" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "c").iterdir()] == ["README.md"]


def test_a_file_that_is_no_earlier_export_is_not_lost(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder of somebody's own program."""
    name = "README.md"
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / name).write_text("mine")
    assert ended("export-c", str(robot), str(tmp_path / "c")) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert name in error
    assert "would be lost" in error
    assert (tmp_path / "c" / name).read_text() == "mine"
    assert [path.name for path in (tmp_path / "c").iterdir()] == [name]


def test_an_earlier_export_is_replaced(robot: Path, tmp_path: Path) -> None:
    for radius in ("0.05", "0.04"):
        robot.write_text(ROBOT.replace("0.05", radius))
        assert ended("export-c", str(robot), str(tmp_path / "c")) == 0
    assert ended("export-c", str(robot), str(tmp_path / "new")) == 0
    for name in ("main.c", "recorded_run.csv", "rehab_pose_tracker.c"):
        assert (tmp_path / "c" / name).read_bytes() == (tmp_path / "new" / name).read_bytes()


def test_an_interrupt_waits_until_all_files_are_there(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    move, ends = Path.replace, []

    def interrupted_replace(draft: Path, target: Path) -> Path:
        if not ends:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
        ends.append(target.name)
        return move(draft, target)

    def ended_by(*_: object) -> None:
        raise SystemExit(130)

    monkeypatch.setattr(Path, "replace", interrupted_replace)
    monkeypatch.setattr("rehab_opt.terminal.interrupted", ended_by)
    assert ended("export-c", str(robot), str(tmp_path / "c")) == 130
    assert {path.name for path in (tmp_path / "c").iterdir()} > NAMES
    assert {path.name for path in tmp_path.iterdir()} == {"robot.toml", "c"}


def test_a_casadi_that_writes_other_code_is_refused(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rehab_opt.export.generated.OLD_C", "#if what no version writes")
    assert ended("export-c", str(robot), str(tmp_path / "c")) == 2
    assert capsys.readouterr().err.startswith("rehab-opt: casadi = '")
    assert {path.name for path in tmp_path.iterdir()} == {"robot.toml"}
