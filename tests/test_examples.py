"""Every script in `examples` runs as it stands, and says what it shows."""

import json
import re
import runpy
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import human_arm
from rehab_opt.session.files import problem_of
from rehab_opt.session.run import arms_of
from rehab_opt.workspace.cp_reach import reach_groups

ROOT = Path(__file__).parents[1]


def printed_by(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    return capsys.readouterr().out


def numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?", text)]


def test_every_example_is_claimed_here() -> None:
    claimed = {"first_steps.ipynb", "follow_pose.py", "help_along_path.py", "own_limit.py", "used_ranges.py"}
    assert {path.name for path in (ROOT / "examples").iterdir() if path.suffix in {".py", ".ipynb"}} == claimed


def test_every_cell_of_the_notebook_prints_what_stands_below_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")
    notebook = json.loads((ROOT / "examples" / "first_steps.ipynb").read_text(encoding="utf-8"))
    names: dict[str, object] = {"__name__": "__main__"}
    for number, cell in enumerate(each for each in notebook["cells"] if each["cell_type"] == "code"):
        exec(compile("".join(cell["source"]), f"first_steps.ipynb, cell {number}", "exec"), names)
        stored = "".join(line for output in cell["outputs"] for line in output["text"])
        assert capsys.readouterr().out == stored, f"cell {number}"
    names["plt"].close("all")  # type: ignore[attr-defined]


def test_a_pose_that_moves_too_fast_is_followed_slowly(capsys: pytest.CaptureFixture[str]) -> None:
    delivered, _ = numbers(printed_by("follow_pose.py", capsys))
    assert 0 < delivered < 100


def test_the_elbow_passes_the_table_without_the_limit_and_not_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    without, limited = printed_by("own_limit.py", capsys).splitlines()
    assert numbers(without)[1] < -10.0
    assert numbers(limited)[1] == pytest.approx(0.0, abs=0.5)  # [mm]


def test_help_stays_within_its_force_limit(capsys: pytest.CaptureFixture[str]) -> None:
    *_, largest = numbers(printed_by("help_along_path.py", capsys))
    assert 0 < largest <= 30


def test_ranges_used_in_recorded_reaches_become_a_problem(
    recorded: Callable[[str], Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = recorded("cp_dyskinetic_reach")
    monkeypatch.setattr(sys, "argv", ["used_ranges.py", str(folder)])
    content = tomllib.loads(printed_by("used_ranges.py", capsys))
    arms = arms_of(problem_of(content, name="used", file="used.toml", path=Path("used.toml")))
    groups = reach_groups(folder)
    assert set(arms) == {", ".join(key) for key in groups}
    for key, found in groups.items():
        arm, used = arms[", ".join(key)], human_arm(side="left", range_of_motion=found.used)
        np.testing.assert_allclose([arm.lower, arm.upper], [used.lower, used.upper], atol=1e-5)
