"""Problems on a plant: the table [plant], --plant, what is refused, and what a run then shows."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest

from rehab_opt import ConfigurationError, ProblemFileError
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.force_robot import ForceRobot, RobotModel
from rehab_opt.plants.hand_robot import MujocoHandRobot, OnMujoco
from rehab_opt.session.files import ProblemFile, load_problem, problem_content, problem_of, problem_path
from rehab_opt.session.plant import (
    JointPlant,
    on_plant,
)
from rehab_opt.session.run import checked, run_problem
from tests.refusals import refuses

CIRCLE = {"circle": {"radius_m": 0.03, "duration_s": 1.5, "turns": 1.0, "swing_deg": 10.0}}


def changed(name: str, **tables: dict[str, Any]) -> ProblemFile[Any]:
    """A shipped problem with some keys of its tables replaced."""
    _, path = problem_path(name)
    content = problem_content(path, name)
    for table, keys in tables.items():
        content[table] = {**content.get(table, {}), **keys}
    return problem_of(content, name=name, file=name, path=path)


def hand_in_mujoco(model: RobotModel) -> MujocoHandRobot:
    kind = OnMujoco(model, Channel(), 0.0, 2.5e-4, 0)
    return MujocoHandRobot(kind, hand_mass=1.2, start=(0.01, 0.0), dt=1e-3, rng=np.random.default_rng(0))


def test_a_plant_that_there_is_not_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    refuses(
        lambda keys: changed("robot/ur5_circle", plant=keys),
        (({"kind": "gazebo"},), "plant.kind", "'ideal', 'mujoco', 'ur', 'franka' or 'ros2'"),
        (({"command_delay_ms": 2.0},), "plant.command_delay_ms", 'no such key except for kind = "mujoco"'),
        (({"kind": "mujoco", "noise": 1.0},), "plant.noise", "one of the keys"),
        error=ProblemFileError,
    )
    refuses(
        lambda name, kind: run_problem(load_problem(name), plant=kind),
        (("upper_limb/figure_eight", "mujoco"), "--plant", "pose_tracking and mirror and scenario and ardis"),
        (("robot/ur5_circle", "gazebo"), "one of ideal, mujoco"),
    )
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ConfigurationError, match=r"rehab_opt\[physics\]"):
        run_problem(load_problem("robot/ur5_circle"), plant="mujoco")
    names = ("robot/ur5_circle", "upper_limb/scenario_2_assist", "ardis/press_lift_button")
    refuses(
        lambda name: checked(changed(name, plant={"kind": "mujoco"})),
        *(((name,), "rehab_opt[physics]") for name in names),
    )


def test_the_option_goes_before_the_file() -> None:
    file = changed("robot/ur5_circle", plant={"kind": "mujoco", "servo_hz": 10.0, "command_delay_ms": 8.0})
    assert on_plant(file, None).problem.plant.servo_hz == 10.0
    assert on_plant(file, "mujoco").problem.plant.command_delay_ms == 8.0
    assert on_plant(file, "ideal").problem.plant.kind == "ideal"
    assert on_plant(load_problem("robot/ur5_circle"), "mujoco").problem.plant == JointPlant(kind="mujoco")


def test_without_delay_the_robot_in_mujoco_is_the_one_that_is_integrated() -> None:
    pytest.importorskip("mujoco")
    model = RobotModel(noise=0.0, coulomb=0.0)
    soon = ForceRobot(model, hand_mass=1.2, start=(0.01, 0.0), dt=1e-3, rng=np.random.default_rng(0), ticks=1000)
    late = hand_in_mujoco(model)
    for k in range(1000):
        for robot in (soon, late):
            force = 6.0 * math.sin(0.01 * k), 2.0 * math.cos(0.02 * k)
            robot.step(*force, 3.0 - 150.0 * robot.x - 12.0 * robot.vx, -150.0 * robot.y - 12.0 * robot.vy)
        assert (late.x, late.y) == pytest.approx((soon.x, soon.y), abs=1e-3)
        if k > 50:
            assert (late.measured_x, late.measured_y) == pytest.approx((soon.measured_x, soon.measured_y), abs=0.1)
    assert late.seen == (late.x, late.y)


def test_the_stops_hold_a_hand_and_the_sensor_does_not_feel_them() -> None:
    pytest.importorskip("mujoco")
    robot = hand_in_mujoco(RobotModel(noise=0.0, upper=(0.03, math.inf)))
    for _ in range(1500):
        robot.step(0.0, 0.0, 10.0, 2.0)
    assert 0.03 <= robot.x < 0.034
    assert robot.y > 0.1
    assert robot.measured_x == pytest.approx(-10.0, abs=0.2)
