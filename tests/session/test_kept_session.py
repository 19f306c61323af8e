"""Numbers, tables and figures of short runs of every kind of problem, kept."""

from __future__ import annotations

import io
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from rich.console import Console

from rehab_opt.session.files import problem_content, problem_of, problem_path, shipped_folder
from rehab_opt.session.run import arms_of, checked, run_problem
from rehab_opt.session.systems import System, system_named
from rehab_opt.session.workspaces import reached
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.region import Workspace
from tests.golden import assert_kept
from tests.golden.drawn import digest
from tests.golden.returns import Returns

FAST = {"run": {"rate_hz": 50.0}, "task": {"trials": 2, "movement_s": 0.8, "rest_s": 0.4}}
TRACKED = {"tracker": {"rate_hz": 50.0}}
SHORT: dict[str, dict[str, Any]] = {
    "robot/ur5_among_bodies": {"circle": {"duration_s": 1.0}, "tracker": {"rate_hz": 60.0}},
    "ardis/press_lift_button": {"goals": 1}, "ardis/kinova_drink": {"goals": 1},
    "mirror/pick_fruit": TRACKED, "mirror/wipe_table": TRACKED,
    "upper_limb/figure_eight": {"run": {"rate_hz": 20.0}}, 
    "upper_limb/workspace": {}, "upper_limb/cp_reach": {"variation": {"people": 2, "spacing_mm": 20.0}},
    "upper_limb/workspace_map": {"map": {"rules": ["safe", "polar"], "audit_points": 500}},
    "upper_limb/scenario_2_learnt": FAST, "upper_limb/scenario_4_follow": FAST,
    "upper_limb/scenario_5_hold": FAST | {"task": {"trials": 1, "movement_s": 0.3, "dwell_s": 0.3}},
    "upper_limb/scenario_together": FAST,
}  # fmt: skip
HEADS = {"pick_fruit.csv": (150, 330), "wipe_table.csv": (0, 200), "wipe_table_helmet.csv": (0, 200), "figure_eight.csv": (0, 120)}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
TIMES = re.compile(r"\bms\b|_ms|time|took")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped problems with the heads of their recordings."""
    folder = tmp_path_factory.mktemp("kept") / "problems"
    shutil.copytree(shipped_folder(), folder)
    for name, (first, last) in HEADS.items():
        for file in folder.rglob(name):
            lines = file.read_text().splitlines(keepends=True)
            file.write_text("".join(lines[:1] + lines[1 + first : 1 + last]))
    return folder


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workspaces are ellipses about as large as those searched, maps of few landmarks."""

    def ellipse(arm: Any, **asked: Any) -> Workspace:
        wide = float(np.sum(arm.upper - arm.lower))
        size = (0.04, 0.026) if wide < 3 else (0.25 + 0.002 * wide, 0.13)
        centre = (-0.172, 0.502) if wide < 3 else (-0.17, 0.45)
        disc = shapely.affinity.scale(shapely.Point(centre).buffer(1.0, quad_segs=9), *size)
        return Workspace(disc, accuracy=asked["accuracy"], height=asked["height"], handle_tilt=asked["handle_tilt"])

    between = WorkspaceMap.between
    few = lambda *sets, **given: between(*sets, **{"landmarks": 50} | given)  # noqa: E731
    monkeypatch.setattr(reached, "planar_workspace", ellipse)
    monkeypatch.setattr(WorkspaceMap, "between", few)


def words(shown: Any) -> list[Any]:
    """A table's words, and its numbers, without times that the computer took."""
    console = Console(width=200, file=io.StringIO(), record=True)
    console.print(shown)
    lines = [line for line in console.export_text().splitlines() if not TIMES.search(line)]
    return [[NUMBER.sub("#", " ".join(line.split())), *map(float, NUMBER.findall(line))] for line in lines]


@pytest.mark.parametrize("name", SHORT)
def test_short_run(name: str, folder: Path) -> None:
    _, path = problem_path(name)
    content = problem_content(path, name)
    for section, keys in SHORT[name].items():
        content[section] = content[section][:keys] if isinstance(keys, int) else {**content.get(section, {}), **keys}
    on = problem_of(content, name=name, file=name, path=folder / path.relative_to(shipped_folder()))
    with Returns("rehab_opt/session/") as seen:
        said = [str(each) for each in checked(on)]
        outcome = run_problem(on)
        system: System[Any, Any] = system_named(outcome.system)
        figures = {key: digest(figure) for key, figure in system.figures(outcome).items()}
        tables = [words(system.table(outcome)), words(system.brief(outcome)), said, list(outcome.notes)]
        arms = {key: [arm.lower, arm.upper] for key, arm in arms_of(on).items()}
    trace = {key: list(column)[:20] for key, column in outcome.trace()}
    short = name.replace("/", ".")
    assert_kept(f"session.{short}", [seen.numbers(), dict(outcome.metrics), trace, arms], relative=1e-4, absolute=1e-7)
    assert_kept(f"session.{short}.shown", [figures, tables], relative=2e-3, absolute=1e-6)
