"""Live problems, tick by tick and without a page: the controllers and plants of `rehab-opt run`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rehab_opt.control.command import Command, Status
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.files import load_problem
from rehab_opt.session.live.bodies import near_limit
from rehab_opt.session.live.problem import AT_REST, LiveControl, LiveInputs
from rehab_opt.session.run import live_problem, run_problem

PROBLEMS = ["robot/ur5_circle", "ardis/through_doorway", "mirror/pick_fruit"]


def ticks(control: LiveControl, inputs: LiveInputs, count: int) -> list[Command]:
    """Commands of so many ticks with the same inputs, in closed loop."""
    commands = []
    for _ in range(count):
        plant = control.plant
        plant.frozen, plant.noise, plant.delay = inputs.frozen, inputs.noise, inputs.delay
        command = control.step(inputs, plant.measured)
        plant.step(control.plant_command(command), inputs.push if any(inputs.push) else None)
        commands.append(command)
    return commands


def begun(name: str) -> tuple[Any, LiveControl]:
    problem = live_problem(load_problem(name))
    control = problem.control()
    control.plant.reset(control.start)
    return problem, control


def test_live_is_the_run_tick_by_tick_while_nobody_touches_it() -> None:
    problem, control = begun("robot/ur5_circle")
    outcome = run_problem(load_problem("robot/ur5_circle"))
    (trace,) = outcome.traces.values()
    commands = ticks(control, LiveInputs(enable=True), 400)
    assert np.array_equal([each.value for each in commands], trace["command"][:400])
    assert problem.dt == pytest.approx(float(np.diff(trace["t_s"][:2])[0]))


def test_the_participant_of_a_chair_sees_one_goal_after_the_other() -> None:
    problem, control = begun("ardis/through_doorway")
    control.step(AT_REST, control.plant.measured)
    shown = {key: np.atleast_1d(np.asarray(value, dtype=np.float64)) for key, value in control.shown().items()}
    first = problem.frame(shown)
    config = load_problem("ardis/through_doorway")
    goals = config.problem.goals
    assert first["goal"] == goals[0].hand_m
    here = goals[0].model_copy(update={"hand_m": first["handles"]["hand"]})
    problem = live_problem(replace(config, problem=config.problem.model_copy(update={"goals": [here, *goals[1:]]})))
    assert problem.frame(shown)["goal"] == goals[1].hand_m


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_robot_can_be_drawn_and_comes_to_rest_when_the_dead_man_is_released(name: str) -> None:
    problem, control = begun(name)
    ticks(control, LiveInputs(enable=True), 5)
    ticks(control, LiveInputs(enable=True, stick=(1.0, 0.0)), 100)
    shown = {key: np.atleast_1d(np.asarray(value, dtype=np.float64)) for key, value in control.shown().items()}
    assert {key: value.size for key, value in shown.items()} == dict(problem.layout)
    frame, scene = problem.frame(shown), problem.scene()
    assert len(frame["numbers"]) == len(scene["plots"])
    assert len(scene["encoders"]) == problem.encoders
    capsules = np.array([each[:7] for each in frame["capsules"]], dtype=np.float64)
    assert np.isfinite(capsules).all()
    assert (capsules[:, 6] > 0).all()
    last = ticks(control, AT_REST, 400)[-1]
    assert last.status is Status.HOLDING
    assert not last.value.any()


def test_a_person_is_helped_where_the_participant_points_and_let_go_with_the_dead_man() -> None:
    problem, control = begun("upper_limb/scenario_2_assist")
    outside = np.array([-0.22, 0.49])  # of the comfortable workspace, where the hand is weak
    assert not problem.task.context.comfortable.contains(outside)
    led = LiveInputs(enable=True, target=(*outside.tolist(), 0.0))
    commands = ticks(control, led, 2500)
    sizes = [float(np.linalg.norm(each.value)) for each in commands]
    assert 1.0 < max(sizes) <= 30.0 + 1e-9
    assert np.linalg.norm(control.plant.truth.position - outside) < 0.05
    assert ticks(control, AT_REST, 500)[-1].status is Status.RELEASED
    shown = {key: np.atleast_1d(np.asarray(value, dtype=np.float64)) for key, value in control.shown().items()}
    frame, scene = problem.frame(shown), problem.scene()
    assert len(frame["numbers"]) == len(scene["plots"])
    assert {key: value.size for key, value in shown.items()} == dict(problem.layout)
    # The arm from the shoulder of the file to the hand, each joint within what can be helped, red at its limit.
    arm, section = frame["capsules"], load_problem("upper_limb/scenario_2_assist").problem.arm
    assert arm[0][:3] == pytest.approx([*section.shoulder_m[:2], -section.plane_height_m], abs=1e-3)
    assert arm[-1][3:6] == pytest.approx(frame["handles"]["hand"], abs=1e-3)
    margins = [min(frame["joints"][row["index"]] - row["lower"], row["upper"] - frame["joints"][row["index"]])
               for row in scene["joints"]]  # fmt: skip
    assert min(margins) > -1e-3
    assert {each[-1] for each in arm} <= {near_limit(each) for each in margins}


def test_two_hands_are_led_each_in_its_own_workspace() -> None:
    """The helper's is led to a place, the participant's drawn to the map of it, and the helper feels that."""
    problem, control = begun("upper_limb/scenario_together")
    place = np.array([-0.1, 0.5])
    ticks(control, LiveInputs(enable=True, helper=(*place.tolist(), 0.0)), 4000)
    shown = {key: np.atleast_1d(np.asarray(value, dtype=np.float64)) for key, value in control.shown().items()}
    assert {key: value.size for key, value in shown.items()} == dict(problem.layout)
    frame, image = problem.frame(shown), problem.task.context.workspace_map.image(place)
    assert frame["handles"]["target"] == pytest.approx([*place.tolist(), 0.0], abs=0.02)
    assert frame["goal"] == pytest.approx([*image.tolist(), 0.0], abs=0.02)
    led = np.array(frame["handles"]["hand"][:2])
    both = LiveInputs(enable=True, helper=(*place.tolist(), 0.0), target=(*(led + [0.0, 0.02]).tolist(), 0.0))
    ticks(control, both, 1500)
    assert control.plant.truth.position[1] > led[1] + 0.002  # the participant pulls, against the spring
    felt = np.array(control.shown()["along"])[2:]
    assert felt[1] > 0.5  # and the helper is drawn along
    assert not np.any(ticks(control, AT_REST, 1000)[-1].value)
    still = np.array(control.shown()["along"])[:2]
    ticks(control, AT_REST, 500)
    assert np.array(control.shown()["along"])[:2] == pytest.approx(still, abs=0.02)  # who wanders, led by nobody


def test_a_dragged_target_is_where_the_hand_goes() -> None:
    problem, control = begun("robot/ur5_circle")
    start = problem.chain.pose(control.start)[:3, 3]
    target = start + [0.05, 0.03, -0.04]
    ticks(control, LiveInputs(enable=True, target=tuple(target.tolist())), 1500)
    hand = problem.frame({k: np.atleast_1d(v) for k, v in control.shown().items()})["handles"]["hand"]
    assert np.linalg.norm(hand - target) < 1e-3


def test_the_stick_must_be_let_go_after_the_dead_man_was() -> None:
    _, control = begun("ardis/through_doorway")
    push = LiveInputs(enable=True, stick=(1.0, 0.0))
    ticks(control, LiveInputs(enable=True), 5)
    assert np.abs(ticks(control, push, 50)[-1].value).max() > 0.05
    ticks(control, push._replace(enable=False), 200)
    held = ticks(control, push, 100)[-1]
    assert not held.value.any()
    assert held.reason == "the stick must be released first"
    ticks(control, LiveInputs(enable=True), 2)
    assert np.abs(ticks(control, push, 50)[-1].value).max() > 0.05


def test_all_that_is_kept_off_is_drawn_and_what_moves_where_it_is() -> None:
    problem, control = begun("robot/ur5_among_bodies")
    around, scene = problem.problem.clearance, problem.scene()
    assert [len(each["points"]) for each in scene["lines"][1:]] == [5]  # the floor
    assert np.array(scene["lines"][1]["points"])[:, 2] == pytest.approx(-0.2)
    box, corners = around.boxes[0], np.array([each["points"] for each in scene["fills"]])
    assert corners.shape == (6, 4, 3)
    assert corners.min(axis=(0, 1)) == pytest.approx(np.array(box.centre_m) - np.array(box.size_m) / 2)
    assert corners.max(axis=(0, 1)) == pytest.approx(np.array(box.centre_m) + np.array(box.size_m) / 2)
    lamp, upper_arm, *_ = still = [each[:7] for each in scene["capsules"]]
    assert lamp == [*around.capsules[0].start_m, *around.capsules[0].end_m, around.capsules[0].radius_m]
    assert len(still) == 4
    assert np.linalg.norm(np.subtract(upper_arm[:3], around.person[0].shoulder_m)) < 0.15
    assert {"planes to keep off", "bodies to keep off", "those that move"} == {name for _, name in scene["legend"]}
    for inputs, count, passed in ((LiveInputs(enable=True), 251, 1.0), (AT_REST, 750, 4.0)):
        ticks(control, inputs, count)
        shown = {key: np.atleast_1d(np.asarray(value, dtype=np.float64)) for key, value in control.shown().items()}
        assert {key: value.size for key, value in shown.items()} == dict(problem.layout)
        tray, own = problem.frame(shown)["capsules"][-1], around.moving[0]
        there = (1 - np.cos(2 * np.pi * passed / own.period_s)) / 2 * np.array(own.towards_m)
        assert tray[:3] == pytest.approx(own.start_m + there, abs=1e-4)
        assert tray[3:7] == pytest.approx([*(own.end_m + there), own.radius_m], abs=1e-4)


def touched() -> TouchedPlant:
    plant = TouchedPlant(IdealJoints(0.01), seed=1)
    plant.reset(np.zeros(2))
    return plant


def test_a_frozen_encoder_repeats_its_last_value_and_the_others_go_on() -> None:
    plant = touched()
    plant.step([1.0, 1.0])
    plant.frozen = 1
    for _ in range(3):
        seen = plant.step([1.0, 1.0])
    assert seen.position == pytest.approx([0.04, 0.01])
    plant.frozen = -1
    assert plant.step([1.0, 1.0]).position == pytest.approx([0.05, 0.05])


def test_a_delay_shows_what_was_so_with_the_stamp_of_then() -> None:
    plant = touched()
    plant.delay = 0.03
    for _ in range(10):
        seen = plant.step([1.0, 0.0])
    assert (seen.stamp, seen.position[0]) == (pytest.approx(0.07), pytest.approx(0.07))


def test_noise_is_of_the_size_that_was_asked_for_and_leaves_the_truth() -> None:
    plant = touched()
    plant.noise = 0.01
    seen = np.array([plant.step([0.0, 0.0]).position for _ in range(4000)])
    assert seen.std(axis=0) == pytest.approx([0.01, 0.01], rel=0.05)
    assert not plant.truth.position.any()
