"""`python -m bench.solvers` as a user meets it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench.qp_recording.sequence import write_sequence
from bench.solvers.__main__ import main
from bench.solvers.command import Interruption
from bench.solvers.record import RECORD
from tests.bench_solvers.fake_solvers import boxes


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own folder with a sequence to work in."""
    write_sequence(tmp_path / "boxes.npz", boxes(40))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ended(*arguments: str) -> int:
    try:
        main(arguments)
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def test_a_comparison_prints_its_tables_and_says_what_it_wrote(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended("--family", "boxes.npz", "--solver", "qrqp-virtual", "--solver", "proxqp") == 0
    printed = capsys.readouterr().out
    assert "box: 40 instances" in printed
    assert "table.md" in printed
    rows = json.loads((folder / "out/bench/results.json").read_text())["rows"]
    assert {(row["solver"], row["mode"], row["solved"]) for row in rows} == {
        (solver, mode, 1.0) for solver in ("qrqp-virtual", "proxqp") for mode in ("cold", "warm")
    }


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--solver", "gurobi2"), "gurobi2"),
        (("--family", "nobody"), "nobody"),
        (("--family", "boxes.npz", "--solver", "ipopt"), "can solve these families: fallback"),
        (("--family", "boxes.npz", "--time-limit", "nan"), "--time-limit"),
        (("--family", "boxes.npz", "--time-limit", "0"), "--time-limit"),
        (("--family", "boxes.npz", "--out", "boxes.npz"), "--out"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_exit_code_2_and_writes_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], named: str
) -> None:
    assert ended(*arguments) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert named in said
    assert [path.name for path in folder.iterdir()] == ["boxes.npz"]


def test_an_interruption_that_a_solver_swallowed_is_seen_at_the_next_step() -> None:
    interruption, seen = Interruption(), []
    progress = interruption.checked(lambda *told: seen.append(told))
    progress("before", 1, 2)
    with contextlib.suppress(KeyboardInterrupt):  # as CasADi does
        interruption()
    with pytest.raises(KeyboardInterrupt):
        progress("after", 2, 2)
    assert seen == [("before", 1, 2)]


@pytest.mark.nightly
def test_interrupted_it_keeps_what_it_has_and_ends_with_130(folder: Path) -> None:
    command = [sys.executable, "-m", "bench.solvers", "--family", "boxes.npz"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, start_new_session=True
    )
    record = folder / "out/bench" / RECORD
    for _ in range(6000):  # however slow the machine
        if record.exists() and record.read_text().count("\n") >= 2:
            break
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to every process
    _, said = process.communicate(timeout=300)
    assert process.returncode == 130, said
    assert said == "interrupted; the same command goes on from here\n"
    assert record.read_text().count("\n") >= 2
    # It comes in the middle of the first sequence, and yet there is a table of what was done before.
    assert (folder / "out/bench/table.md").read_text().startswith("Not whole: ")
