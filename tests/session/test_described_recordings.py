"""A recording is described once, and every problem and `score` read the same of it."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import load_problem, shipped_folder
from rehab_opt.session.scoring import described, score_recordings, write_rows
from tests.measures.yardstick import reach
from tests.refusals import refuses

ARM = '[arm]\nside = "left"\nrange_of_motion = "restricted"\n'
SCENARIO = (shipped_folder() / "upper_limb" / "scenario_4_pen_trace.toml").read_text()
FORMS = {
    "upper_limb": 'system = "upper_limb"\ntitle = "t"\n{}\n' + ARM,
    "scenario": re.sub(r"(?m)^recording.*\nplacement.*$", "{}", SCENARIO.replace("{", "{{").replace("}", "}}")),
}
RECORDING = {"file": "raw/a.csv", "hand": "right", "columns": ["x", "z"], "separator": "semicolon"}
PLACEMENT = {"centre_m": [-0.172, 0.502], "turn_deg": 5.0}


def inline(table: dict[str, Any]) -> str:
    return (
        "{"
        + ", ".join(f"{key} = {str(value).lower() if value is True else repr(value)}" for key, value in table.items())
        + "}"
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "raw").mkdir()
    time, points = reach(100, rest=0.3)
    rows = "".join(f"{t:.6f};{x:.6f};0;{y:.6f}\n" for t, (x, y) in zip(time, points, strict=True))
    (tmp_path / "raw" / "a.csv").write_text(f"t_s;x_m;y_m;z_m\n{rows}")
    columns = {**RECORDING, "file": "a.csv", "columns": ["x_m", "z_m"]}
    (tmp_path / "raw" / "a.toml").write_text(f"recording = {inline(columns)}\nplacement = {inline(PLACEMENT)}\n")
    return tmp_path


@pytest.mark.parametrize("kind", FORMS)
def test_a_problem_reads_a_described_recording_as_if_it_stood_in_it(folder: Path, kind: str) -> None:
    form = FORMS[kind]
    own = {**RECORDING, "columns": ["x_m", "z_m"], "mirror": True}
    said = {"description": "raw/a.toml", "mirror": True}
    (folder / "one.toml").write_text(form.format(f"recording = {inline(own)}\nplacement = {inline(PLACEMENT)}"))
    (folder / "two.toml").write_text(form.format(f"recording = {inline(said)}"))
    one, two = (load_problem(str(folder / name)).problem for name in ("one.toml", "two.toml"))
    assert one == two
    moved = {**PLACEMENT, "centre_m": [-0.2, 0.45]}
    (folder / "two.toml").write_text(form.format(f"recording = {inline(said)}\nplacement = {inline(moved)}"))
    third = load_problem(str(folder / "two.toml")).problem
    place = third.task.placement if kind == "scenario" else third.placement
    assert place.centre_m == [-0.2, 0.45]


def test_score_reads_a_described_recording_as_its_options_would(folder: Path) -> None:
    reading = {"columns": ["x_m", "z_m"], "separator": "semicolon"}
    texts = []
    for file, how in ((str(folder / "raw" / "a.toml"), {}), (str(folder / "raw" / "a.csv"), reading)):
        scored = score_recordings([file], reading=how)
        assert scored.trials[0][0].file == str(folder / "raw" / "a.csv")
        text = io.StringIO()
        write_rows(scored.rows, text)
        texts.append(text.getvalue())
    assert texts[0] == texts[1]
    assert described(str(folder / "raw" / "a.toml"), {"marker": None}).reading == {**reading, "marker": None}


def test_a_description_that_cannot_be_used_is_refused_by_its_own_name(folder: Path) -> None:
    file = folder / "raw" / "a.toml"
    refuses(
        lambda text: file.write_text(text) and described(str(file)),
        (("recording = {hand = 'left'}",), "a.toml", "recording.file"),
        (("recording = {file = 'a.csv', hand = 'left'}\nperson = {}",), "a.toml", "person"),
        (("recording = 'b.toml'",), "a.toml", "recording"),
        (("recording = {file = 'a.csv', hand = 'left', marker = 'X'}",), "a.toml", "marker"),
        (("title = [",), "a.toml", "line 1"),
        error=ProblemFileError,
    )
    for name in ("raw/b.toml", "raw/a.csv", "\\u0000"):
        (folder / "p.toml").write_text(f'system = "upper_limb"\ntitle = "t"\nrecording = "{name}"\n{ARM}')
        with pytest.raises(ProblemFileError):
            load_problem(str(folder / "p.toml"))
