"""Claims about the five scenarios, on the shipped problem files."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from bench.scenarios import FOLLOWED, FRESH, SCENARIOS, changed, judged, projected
from bench.verdict import all_met
from rehab_opt import Status
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.plants.force_robot import ForceRobot, RobotModel
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.run import run_problem
from rehab_opt.session.scenario.scene import ScenarioSystem, trials_of
from rehab_opt.session.systems import NotMet
from rehab_opt.workspace.mapping import WorkspaceMap
from tests.refusals import refuses

FAST = {"rate_hz": 400.0, "laws": ["unassisted", "assisted"]}
"""The full rate, and every number, by `python -m bench.scenarios`."""
SHORTER = {"scenario_4_follow": {"movement_s": 8.0}, "scenario_5_hold": {"movement_s": 0.7, "dwell_s": 1.0}}


@pytest.fixture(autouse=True)
def _found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps, which take seconds, are those of the first test that asks for the same ones, as workspaces are."""
    monkeypatch.setattr(WorkspaceMap, "between", _between)


BETWEEN = WorkspaceMap.between
MADE: dict[object, object] = {}


def _between(source: object, target: object) -> object:
    told = (id(source), id(target))
    if told not in MADE:
        MADE[told] = BETWEEN(source, target)  # type: ignore[arg-type]
    return MADE[told]


@cache
def outcome(name: str, people: int = 3) -> Outcome:
    task = {"trials": people, **SHORTER.get(name, {})}
    config = changed(name, task=task, run=FAST)
    found = run_problem(config)
    return found


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "people"), [*((name, 3) for name in SCENARIOS[:3]), ("scenario_5_hold", 20)])
def test_what_the_paper_reports_of_a_scenario_is_seen(name: str, people: int) -> None:
    missed = [str(verdict) for verdict in judged(name, outcome(name, people)) if not verdict.met]
    assert missed == []


def ratio(found: Outcome, key: str) -> np.ndarray:
    """(people,) a measure with help / without."""
    ours, none = (
        np.array([each[key] for each in trials_of(found).measures[law]]) for law in ("assisted", "unassisted")
    )
    return np.asarray(ours / none)


def off_the_path(found: Outcome, law: str) -> int:
    """Ticks in which the hand is more than a width off the path."""
    width = 1e-3 * found.metrics["parameters"]["field"]["width_mm"]
    of = trials_of(found)
    return sum(
        int((projected(trial["_hand"], of.context.reference).distance > width).sum()) for trial in of.trials[law]
    )  # type: ignore[index]


def test_help_along_a_path_brings_the_hand_nearer_to_it_and_to_where_the_person_means_to_be() -> None:
    """A slice at the file's speed; bench/RESULTS.md has all people, and the trials that are worse with help."""
    run = {**FAST, "laws": ["unassisted", "assisted"]}
    found = run_problem(changed(FOLLOWED, task={"trials": 2, "seed": FRESH}, run=run))
    assert np.all(ratio(found, "deviation_mean_m") <= 0.5)
    assert np.all(ratio(found, "from_intended_mean_m") < 1.0)
    assert off_the_path(found, "assisted") <= 0.1 * off_the_path(found, "unassisted")
    of = trials_of(found)
    for trial in of.trials["assisted"]:  # the help ends at the end
        at_end = np.linalg.norm(trial["_hand"] - of.context.reference[-1], axis=1) < 1e-3
        assert not at_end[-1] or np.linalg.norm(trial["force_commanded"][-1]) < 1e-9


@pytest.mark.parametrize("name", ["scenario_2_assist", "scenario_5_hold"])
def test_no_help_and_no_number_meet_no_verdict(name: str) -> None:
    found = outcome(name)
    assert all_met(judged(name, found))
    measures = trials_of(found).measures
    idle = {"assisted": measures["unassisted"], "unassisted": measures["unassisted"]}
    assert not all_met(judged(name, found, idle))
    blind = [dict.fromkeys(each) for each in measures["assisted"]]
    assert not any(verdict.met for verdict in judged(name, found, {**measures, "assisted": blind}))


@pytest.mark.parametrize("name", ["scenario_2_assist", "scenario_5_hold"])
def test_no_bound_of_the_force_is_exceeded_in_a_run(name: str) -> None:
    found = outcome(name)
    bounds = found.metrics["parameters"]["assistance"]
    for trial in trials_of(found).trials["assisted"]:
        commanded = trial["force_commanded"]
        sizes = np.linalg.norm(commanded, axis=1)
        changes = np.linalg.norm(np.diff(commanded, axis=0), axis=1)
        assert sizes.max() <= bounds["force_limit_N"]
        assert changes.max() <= bounds["slew_limit_N_s"] / FAST["rate_hz"] * (1 + 1e-9)  # type: ignore[operator]
        assert set(trial["status"][~trial["_let_go"]].tolist()) == {Status.OK.value}
        work = float((commanded[:-1] * np.diff(trial["_hand"], axis=0)).sum())
        assert work <= bounds["energy_budget_J"]


def test_the_reference_of_a_mapped_scenario_lies_in_the_comfortable_workspace() -> None:
    found = outcome("scenario_5_hold")
    of = trials_of(found).context
    areas = {"comfortable_cm2": 1e4 * of.comfortable.area, "reachable_cm2": 1e4 * of.reachable.area}
    assert found.metrics["workspaces"] == pytest.approx(areas)
    assert np.all(of.comfortable.contains(of.reference))
    assert of.demonstrated is not None
    assert not np.all(of.comfortable.contains(of.demonstrated))
    assert np.all(of.reachable.contains(of.demonstrated))


def test_a_shoulder_placed_elsewhere_changes_nothing_but_the_frame() -> None:
    shift, turn = np.array([0.6, -0.3]), 30.0
    arm = {"shoulder_m": [*shift.tolist(), 0.1], "shoulder_turn_deg": turn}
    quick = {"task": {"trials": 1}, "run": {"rate_hz": 200.0, "laws": ["assisted"]}}
    person = {"tremor_N": 0.0, "wander_mm": 0.0, "spasms_per_s": 0.0}  # moods have directions of their own
    robot = {"sensor_noise_N": 0.0}
    here = run_problem(changed("scenario_2_assist", person=person, robot=robot, **quick))
    there = run_problem(changed("scenario_2_assist", person=person, robot=robot, arm=arm, **quick))
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    moved = here.traces["assisted", 0]["_hand"] @ np.array([[c, -s], [s, c]]).T + shift
    elsewhere = there.traces["assisted", 0]["_hand"]
    count = min(len(moved), len(elsewhere))
    np.testing.assert_allclose(elsewhere[:count], moved[:count], atol=5e-4)


# --------------------------------------------------------------------------------------------- robot, person, intention
def test_the_force_loop_delivers_what_is_commanded() -> None:
    """Against a hand held fast by a stiff spring, friction notwithstanding."""
    robot = ForceRobot(
        RobotModel(noise=0.0), hand_mass=1.2, start=(0.0, 0.0), dt=1e-3, rng=np.random.default_rng(0), ticks=3000
    )
    for _ in range(3000):
        robot.step(8.0, -6.0, -3000.0 * robot.x - 60.0 * robot.vx, -3000.0 * robot.y - 60.0 * robot.vy)
    np.testing.assert_allclose([robot.measured_x, robot.measured_y], [8.0, -6.0], atol=1e-3)
    np.testing.assert_allclose([robot.x, robot.y], [8.0 / 3000, -6.0 / 3000], atol=1e-6)


@pytest.mark.parametrize("coulomb", [1.5, 100.0])
@pytest.mark.parametrize("dt", [2e-4, 1e-3, 5e-3, 2e-2])
def test_dry_friction_brings_a_hand_to_rest_and_never_turns_it_round(dt: float, coulomb: float) -> None:
    model = RobotModel(noise=0.0, coulomb=coulomb, gain=0.0, integral=0.0)
    robot = ForceRobot(model, hand_mass=1.2, start=(0.0, 0.0), dt=dt, rng=np.random.default_rng(0), ticks=10_000)
    robot.vx, robot.vy = 0.2, -0.1
    sizes = [math.hypot(robot.vx, robot.vy)]
    for _ in range(round(2.0 / dt)):
        robot.step(0.0, 0.0, 0.0, 0.0)
        assert robot.vx >= 0.0 >= robot.vy
        sizes.append(math.hypot(robot.vx, robot.vy))
    assert np.all(np.diff(sizes) <= 0.0)
    assert sizes[-1] < 1e-9


@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize(("stiffness", "damping"), [(0.0, 8.0), (300.0, 30.0), (2000.0, 30.0), (200.0, 900.0)])
def test_the_growth_that_is_foretold_is_that_of_a_simulation(dt: float, stiffness: float, damping: float) -> None:
    model = RobotModel(noise=0.0, coulomb=0.0, motor_limit=1e300)
    robot = ForceRobot(model, hand_mass=1.2, start=(1e-3, 0.0), dt=dt, rng=np.random.default_rng(0), ticks=600)
    sizes = []
    for _ in range(600):
        robot.step(0.0, 0.0, -stiffness * robot.x - damping * robot.vx, 0.0)
        sizes.append(math.hypot(robot.x, robot.vx, robot.measured_x))
    seen = (max(sizes[-150:]) / max(sizes[-300:-150])) ** (1 / 150)
    assert seen == pytest.approx(model.growth(1.2, stiffness=stiffness, damping=damping, dt=dt), abs=0.02)


@pytest.mark.parametrize("integral", [0.0, 60.0, 1000.0])
@pytest.mark.parametrize("dt", [1e-3, 2e-2])
def test_a_force_loop_is_refused_where_it_is_unstable_and_nowhere_else(integral: float, dt: float) -> None:
    """The gain's bound in closed form beside eigenvalues; a heavy pair, which a loop alone decides."""
    most = 2.0 - 0.5 * integral * dt
    for gain, stable in ((0.99 * most, True), (1.01 * most, False)):
        if gain <= 0:
            continue
        model = RobotModel(mass=1e3, viscous=0.0, gain=gain, integral=integral)
        assert (model.growth(1e3, stiffness=0.0, damping=0.0, dt=dt) <= 1 + 1e-6) == stable
        if stable:
            model.check(1e3, dt=dt)
        else:
            with pytest.raises(ConfigurationError, match=rf"^gain = {gain}: expected less than {most:.3g}:"):
                model.check(1e3, dt=dt)


def test_a_task_that_no_force_is_given_in_is_said_to_be_one() -> None:
    """Everything a therapy mode does is outside W_c: trials without any force all "succeeded", without a word."""
    within = changed("scenario_2_assist", task={"points_m": [[-0.16, 0.505], [-0.18, 0.50]]})
    (note,) = (note for note in ScenarioSystem().check(within) if isinstance(note, NotMet))
    assert "arm.comfortable" in note
    assert not any(isinstance(note, NotMet) for note in outcome("scenario_2_assist").notes)


def test_a_loop_that_throws_the_hand_is_said_to_do_so() -> None:
    """At 40 Hz every force comes too late."""
    stiff = {"assistance": {"slew_limit_N_s": 1000.0, "speed_cap_m_s": 0.3}, "field": {"stiffness_N_m": 1e4}}
    slow = {"rate_hz": 40.0, "laws": ["unassisted", "assisted"]}
    found = run_problem(changed("scenario_3_resist", task={"trials": 1}, run=slow, **stiff))
    thrown = float(np.linalg.norm(found.traces["assisted", 0]["velocity"], axis=1).max())
    assert thrown > 0.3
    assert f"assisted: the hand reached {thrown:.3g} m/s, beyond the speed cap of 0.3 m/s" in found.notes
    assert not any("speed cap" in note for note in outcome("scenario_3_resist").notes)


# ------------------------------------------------------------------------------------------------------- hostile files
def run_changed(name: str, sections: dict[str, Any]) -> None:
    """Checked first: most is refused before any workspace is found."""
    config = changed(name, **sections)
    ScenarioSystem().check(config)
    run_problem(config)


def test_what_cannot_be_done_is_refused_by_the_key_that_says_it() -> None:
    refuses(
        run_changed,
        (("scenario_2_assist", {"task": {"points_m": [[-0.16, 0.5], [-0.16, 1.2]]}}), "task.points_m"),
        (("scenario_2_assist", {"task": {"start_m": [0.0, 0.0]}}), "task.start_m"),
        (("scenario_2_assist", {"field": {"resistance_N": 5.0}}), "field.resistance_N"),
        (("scenario_3_resist", {"field": {"resistance_N": 0.0}}), "field.resistance_N"),
        (("scenario_3_resist", {"field": {"drag_N_m": 10.0}}), "field.drag_N_m"),
        (("scenario_5_hold", {"field": {"drag_N_m": 10.0}}), "field.drag_N_m"),
        (("scenario_1_stretch", {"field": {"width_mm": math.nan}}), "field.width_mm"),
        (("scenario_1_stretch", {"robot": {"gain": 5.0}}), "robot.gain"),
        (("scenario_1_stretch", {"robot": {"integral_per_s": 1000.0}, "run": {"rate_hz": 50.0}}), "robot.gain"),
        (("scenario_1_stretch", {"robot": {"viscous_Ns_m": 500.0}, "run": {"rate_hz": 50.0}}), "run.rate_hz"),
        (("scenario_1_stretch", {"person": {"passive_damping_Ns_m": 500.0}, "run": {"rate_hz": 50.0}}), "run.rate_hz"),
        (("scenario_1_stretch", {"person": {"hand_mass_kg": 0.01}, "robot": {"mass_kg": 1e-6}}), "run.rate_hz"),
        (("scenario_3_resist", {"task": {"points_m": [[-0.17, 0.5], [-0.17, 0.5]]}}), "task.points_m"),
        (("scenario_2_assist", {"task": {"movement_s": 1e-300, "rest_s": 0.0}}), "task.movement_s"),
        (("scenario_5_hold", {"task": {"dwell_s": 600.0, "trials": 1000}}), "task.trials"),
        (("scenario_5_hold", {"person": {"wander_s": 1e9}}), "person.wander_s"),
        (("scenario_5_hold", {"person": {"tremor_hz": 30.0}, "run": {"rate_hz": 50.0}}), "person.tremor_hz"),
        (("scenario_5_hold", {"field": {"width_mm": 1e-3}}), "field.width_mm"),
        (("scenario_1_stretch", {"robot": {"lower_m": [0.0, 0.0], "upper_m": [0.1, 0.1]}}), "arm.shoulder_m"),
        (("scenario_1_stretch", {"robot": {"lower_m": [0.0, 0.0], "upper_m": [0.0, 0.1]}}), "robot.upper_m"),
        (("scenario_4_follow", {"task": {"mapped": False}}), "task.placement"),
        (("scenario_4_follow", {"task": {"recording": {"file": "absent.csv", "hand": "left"}}}), "task.recording.file"),
        (("scenario_4_follow", {"run": {"solver": "nonsense"}}), "run.solver"),
        (("scenario_4_follow", {"arm": {"plane_height_m": -2.0}}), "arm.comfortable"),
        error=ProblemFileError,
    )


def test_a_robot_that_is_unstable_in_the_helpers_hand_alone_is_refused_by_key() -> None:
    light = {"person": {"hand_mass_kg": 0.3}, "robot": {"gain": 4.0}, "task": {"trials": 1}}
    with pytest.raises(ProblemFileError, match=r"robot\.gain.*helper"):
        run_problem(changed("scenario_together", run={"rate_hz": 1000.0, "laws": ["together"]}, **light))


def test_with_a_helper_the_participant_keeps_to_the_path_and_no_delay_makes_the_pair_active() -> None:
    config = changed("scenario_together", task={"trials": 1, "movement_s": 8.0}, run={"rate_hz": 400.0})
    found = run_problem(config)
    budget, of = found.metrics["parameters"]["assistance"]["energy_budget_J"], trials_of(found)
    for law in ("together", "delayed"):
        for alone, led in zip(of.measures["unassisted"], of.measures[law], strict=True):  # type: ignore[index]
            assert led["deviation_mean_m"] <= 0.5 * alone["deviation_mean_m"]
            assert led["pair_energy_drawn_max_J"] <= 2 * budget
            assert led["helper_force_max_N"] <= 30.0
    assert np.all(of.context.reachable.distance(found.traces["together", 0]["helper"]) < 0.02)
    assert any(note.startswith("delayed: the helper felt") for note in found.notes)
    with pytest.raises(ProblemFileError, match=r"run\.laws"):
        changed("scenario_2_assist", run={"laws": ["together"]})
