"""Numbers, tables and figures of short runs of every kind of problem, kept."""

from __future__ import annotations

import io
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from rich.console import Console

from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.drawing import styled
from rehab_opt.session.files import load_problem, problem_content, problem_of, problem_path, shipped_folder
from rehab_opt.session.keys import keys_of
from rehab_opt.session.live.problem import Following, LiveInputs
from rehab_opt.session.many.participants import cell_value, participants_of
from rehab_opt.session.run import arms_of, checked, live_problem, run_problem
from rehab_opt.session.scenario.figures import trials_figures
from rehab_opt.session.scoring import score_recordings
from rehab_opt.session.systems import System, system_named, systems
from rehab_opt.session.workspaces import reached
from rehab_opt.workspace.region import Workspace
from tests.golden import assert_kept
from tests.golden.drawn import digest
from tests.golden.returns import sums
from tests.session.made_trials import made_outcome
from tests.session.test_robot import PATH

FAST = {"run": {"rate_hz": 50.0}, "task": {"trials": 1, "movement_s": 0.4, "rest_s": 0.2}}
TRACKED = {"tracker": {"rate_hz": 50.0}}
SHORT: dict[str, dict[str, Any]] = {
    "robot/ur5_among_bodies": {"circle": {"duration_s": 0.4}, "tracker": {"rate_hz": 50.0}},
    "ardis/press_lift_button": {"goals": 1, "run": {"rate_hz": 50.0}, "stick": {"simulated": ["mecanum"]}},
    "mirror/wipe_table": TRACKED,
    "upper_limb/figure_eight": {"run": {"rate_hz": 20.0}},
    "upper_limb/workspace": {},
    "upper_limb/scenario_together": FAST,
}  # fmt: skip
PLANTS = {"robot/ur5_among_bodies": "mujoco"}
"""Runs that are on another plant than their file says: on their own all others are."""
HEADS = {
    "pick_fruit.csv": (150, 250),
    "wipe_table.csv": (0, 60),
    "wipe_table_helmet.csv": (0, 60),
    "figure_eight.csv": (0, 40),
}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
TIMES = re.compile(r"\bms\b|_ms|time|took|seconds")


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
    """Workspaces are ellipses about as large as those searched."""

    def ellipse(arm: Any, **asked: Any) -> Workspace:
        wide = float(np.sum(arm.upper - arm.lower))
        size = (0.04, 0.026) if wide < 3 else (0.25 + 0.002 * wide, 0.13)
        centre = (-0.172, 0.502) if wide < 3 else (-0.17, 0.45)
        disc = shapely.affinity.scale(shapely.Point(centre).buffer(1.0, quad_segs=9), *size)
        return Workspace(disc, accuracy=asked["accuracy"], height=asked["height"], handle_tilt=asked["handle_tilt"])

    monkeypatch.setattr(reached, "planar_workspace", ellipse)


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
    said = [str(each) for each in checked(on)] if not name.startswith("mirror") else []  # seconds of seats
    outcome = run_problem(on, plant=PLANTS.get(name))
    system: System[Any, Any] = system_named(outcome.system)
    with styled():
        drawn = system.figures(outcome)
    for figure in drawn.values():
        assert figure.get_figwidth() in {3.5, 7.2}
        assert figure.get_label().endswith(".")
        assert not figure.get_suptitle()
    figures = {key: digest(figure) for key, figure in drawn.items()}
    tables = [words(system.table(outcome)), words(system.brief(outcome)), said, list(outcome.notes)]
    trace = {key: np.asarray(column)[:20].tolist() for key, column in outcome.trace()}
    arms = {key: [arm.lower, arm.upper] for key, arm in arms_of(on).items()}
    short = name.replace("/", ".")
    assert_kept(f"session.{short}", [dict(outcome.metrics), trace, arms], relative=1e-4, absolute=1e-7)
    assert_kept(f"session.{short}.shown", [figures, tables], relative=2e-3, absolute=1e-6)


LIVE = ("mirror/pick_fruit",)
TOUCHED = (LiveInputs(enable=True), LiveInputs(enable=True, push=(3.0, -2.0, 1.0), noise=1e-3),
           LiveInputs(enable=False),
           LiveInputs(enable=True, target=(0.3, -0.3, 0.5), delay=0.02), LiveInputs(enable=True, stick=(0.7, -0.4)),
           LiveInputs(enable=True, stick=(-0.5, 0.9), switch=True, gripper=True, frozen=1), LiveInputs(enable=True),
           LiveInputs(enable=True, helper=(-0.1, 0.5, 0.0)))  # fmt: skip


@pytest.mark.parametrize("name", LIVE)
def test_live(name: str, folder: Path) -> None:
    _, path = problem_path(name)
    on = problem_of(problem_content(path, name), name=name, file=name, path=folder / path.relative_to(shipped_folder()))
    problem = live_problem(on)
    control, more = problem.control(), [problem.scene(), [*problem.layout.items()], sorted(problem.touchable)]
    control.plant.reset(control.start)
    for k, inputs in enumerate(each for each in TOUCHED for _ in range(3)):
        plant = control.plant
        plant.frozen, plant.noise, plant.delay = inputs.frozen, inputs.noise, inputs.delay
        command = control.step(inputs, plant.measured)
        plant.step(control.plant_command(command), inputs.push if any(inputs.push) else None)
        shown = {key: np.atleast_1d(np.asarray(value, dtype=float)) for key, value in control.shown().items()}
        more += [problem.frame(shown), control.untouched(0.01 * k), command.value, command.status]
    numbers = [sums(each) for each in more]
    assert_kept(f"session.live.{path.stem}", numbers, relative=1e-4, absolute=1e-7)


@pytest.mark.parametrize("then", ["again", "back", "stay"])
def test_a_followed_path_goes_on_as_it_says(then: Any) -> None:
    """Poses numbered by x, against the order written out."""
    poses, n = np.tile(np.eye(4), (4, 1, 1)), 4
    poses[:, 0, 3] = np.arange(n)
    twists = np.arange(n)[:, None] * np.ones(6)
    asked: list[tuple[float, float]] = []
    tracker = SimpleNamespace(step=lambda q, pose, twist, **_: asked.append((pose[0, 3], twist[0])))
    plant = IdealJoints(0.01)
    plant.reset(np.zeros(6))
    follows = Following(tracker, plant, np.zeros(6), poses, twists, then=then)
    for _ in range(15):
        follows.step(LiveInputs(enable=True), plant.measured)
    there, back = [(k, k) for k in range(n)], [(2, -2), (1, -1)]
    rest = [(n - 1, 0)] * 15
    assert asked == {"again": there * 4, "back": (there + back) * 3, "stay": there + rest}[then][:15]


def test_parts(folder: Path, tmp_path: Path) -> None:
    more = list[Any]()
    file, path = folder / "upper_limb/figure_eight.csv", tmp_path / "path.toml"
    path.write_text(PATH.replace("path.csv", str(file)))
    ran = load_problem(str(path))
    more += [dict(run_problem(ran).metrics) | {"parameters": 0}]
    more += [[*digest(figure)] for figure in trials_figures(made_outcome("resist", trials=1)).values()]
    for source in (file, folder / "upper_limb/demonstrations/lead_1.csv"):
        scored = score_recordings([str(source)], pause=0.2 if source is file else None, target=[0.1, 0.4])
        more += [[row._asdict() | {"file": ""} for row in scored.rows]]
    people = tmp_path / "people.csv"
    people.write_text(
        'participant,arm.side,arm.segments.humerus_mm,arm.shoulder_m\nA,right,310,\nB,,290,"[0.1, 0, 0.9]"\n'
    )
    more += [each.problem().problem.model_dump() for each in participants_of(people, problem="upper_limb/workspace")]
    more += [cell_value(each) for each in ("1", "1.5", "true", "[1, 2]", "word", "'x'", "29#0", "")]
    assert_kept("session.parts", [sums(each) for each in more], relative=1e-3, absolute=1e-6)


def test_keys_their_values_and_defaults_are_those_kept() -> None:
    found = {name: [row[:3] for each in keys_of(system_named(name).schema) for row in each.rows] for name in systems()}
    assert_kept("session.keys", found)
