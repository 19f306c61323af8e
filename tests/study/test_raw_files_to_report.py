"""The commands of `docs/howto/raw_files_to_report.md`, as they stand there: C3D, OpenSim and BIDS agree."""

from __future__ import annotations

import csv
import hashlib
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from rehab_opt.cli import main
from tests.session.made_c3d import of_trc

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "raw_files_to_report.md"


def measures(file: str) -> dict[str, float]:
    with Path(file).open(encoding="utf-8", newline="") as rows:
        return {row["measure"]: float(row["value"]) for row in csv.DictReader(rows) if row["value"]}


def test_three_formats_go_from_raw_files_to_a_report(
    recorded: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, trc = PAGE.read_text(encoding="utf-8"), recorded("upper_limb_mocap/markers.trc")
    recorded("pen_trace/signal.svc")
    sums = re.search(r"`([0-9a-f]+)\.\.\.`", text)
    assert sums is not None
    assert hashlib.sha256(trc.read_bytes()).hexdigest().startswith(sums[1])
    monkeypatch.chdir(tmp_path)
    description = re.search(r"```toml\n# (\S+)\n(.*?)```", text, re.DOTALL)
    assert description is not None
    Path(description[1]).write_text(description[2], encoding="utf-8")
    lines = [line for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL) for line in block.splitlines()]
    assert len(lines) == 8
    for line in lines:
        words = shlex.split(line)
        if words[0] == "python":
            Path(words[-1]).write_bytes(of_trc(trc))
            continue
        with pytest.raises(SystemExit) as done:
            main(words[1:])
        assert not done.value.code, line
    opensim, c3d, bids = (measures(name) for name in ("week1.csv", "week2.csv", "bids.csv"))
    assert len(opensim) >= 10
    assert opensim == pytest.approx(c3d, rel=1e-3)  # single precision, of positions
    assert opensim == pytest.approx(bids, rel=1e-3)
    page = Path("P01.html").read_text(encoding="utf-8")
    assert "week 1" in page
    assert "week 2" in page
    assert "2 people" in Path("study.html").read_text(encoding="utf-8")
