"""The commands of `docs/howto/raw_files_to_report.md`, as they stand there: public files of four formats, to a page."""

from __future__ import annotations

import csv
import hashlib
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from rehab_opt.cli import main
from rehab_opt.recordings.data_folder import ORIGINS, data_folder
from tests.session.made_c3d import of_trc

PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "raw_files_to_report.md").read_text(encoding="utf-8")
LINES = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]
SUMS = dict(reversed(pair) for pair in re.findall(r"^    ([0-9a-f]{64})  (\S+)$", PAGE, re.MULTILINE))


def measures(file: str) -> dict[str, float]:
    with Path(file).open(encoding="utf-8", newline="") as rows:
        return {row["measure"]: float(row["value"]) for row in csv.DictReader(rows) if row["value"]}


def recordings(words: list[str]) -> list[Path]:
    return [Path(word.removeprefix("data:")) for word in words if word.startswith("data:")]


def run(words: list[str]) -> object:
    with pytest.raises(SystemExit) as done:
        main(words[1:])
    return done.value.code or 0


def test_files_of_four_formats_go_from_raw_to_a_report(
    recorded: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    trc = recorded("upper_limb_mocap/markers.trc")
    recorded("pen_trace/signal.svc")
    monkeypatch.chdir(tmp_path)
    description = re.search(r"```toml\n# (\S+)\n(.*?)```", PAGE, re.DOTALL)
    assert description is not None
    Path(description[1]).write_text(description[2], encoding="utf-8")
    assert len(LINES) == 8
    absent = []
    for line in LINES:
        words = shlex.split(line)
        there = [(data_folder() / file).exists() for file in recordings(words)]
        if words[0] == "python":
            Path(words[-1]).write_bytes(of_trc(trc))
        elif all(there):
            assert run(words) == 0, line
        else:  # told of, with where it comes from
            assert run(words) == 2, line
            (file,) = recordings(words)
            assert ORIGINS[file.parts[0]] in capfd.readouterr().err
            absent.append(file)
    opensim, c3d = (measures(name) for name in ("week1.csv", "week2.csv"))
    assert len(opensim) >= 10
    assert opensim == pytest.approx(c3d, rel=1e-3)  # single precision, of positions
    page = Path("P01.html").read_text(encoding="utf-8")
    assert "week 1" in page
    assert "week 2" in page
    assert f"{4 - len(absent)} people" in Path("study.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SUMS)
def test_a_public_file_is_the_one_that_the_page_speaks_of(name: str) -> None:
    folders = {file.parent for line in LINES for file in recordings(shlex.split(line))}
    found = [file for folder in folders if (file := data_folder() / folder / name).exists()]
    if not found:
        pytest.skip(f"{name} is in none of {data_folder()}/{{{', '.join(map(str, folders))}}}: see the page")
    assert hashlib.sha256(found[0].read_bytes()).hexdigest() == SUMS[name]
