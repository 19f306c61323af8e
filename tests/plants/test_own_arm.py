"""Arms from files on the MuJoCo plant, by the masses and efforts that stand in the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rehab_opt import ConfigurationError, ProblemFileError, SerialChain, export_c, ur5
from rehab_opt.plants.arm_model import own_arm_model
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem
from tests.export.calling_c import Built, largest_difference
from tests.export.conftest import built, c_compiler  # noqa: F401  (fixtures)

ROBOTS = Path(__file__).parents[2] / "problems/robots"
CIRCLE = """
system = "pose_tracking"
title = "a circle"
[robot]
file = "robot.toml"
start_deg = {start}
[circle]
radius_m = 0.03
duration_s = 2.5
[tracker]
rate_hz = 500.0
"""
ROBOT = """
urdf = "{urdf}"
tip = "{tip}"
acceleration_deg_s2 = 429.0
"""
ARMS = {
    "Panda": ("franka_panda/panda.urdf", "panda_link8", [0, -45, 0, -135, 0, 90, 45], (87.0,) * 4 + (12.0,) * 3),
    "Gen3": ("kinova_gen3/gen3.urdf", "end_effector_link", [0, 30, 180, -100, 0, -60, 90], (39.0,) * 4 + (9.0,) * 3),
}


def problem_of(folder: Path, arm: str) -> str:
    urdf, tip, start, _ = ARMS[arm]
    (folder / "robot.toml").write_text(ROBOT.format(urdf=ROBOTS / urdf, tip=tip))
    (folder / "circle.toml").write_text(CIRCLE.format(start=start))
    return str(folder / "circle.toml")


@pytest.mark.parametrize("arm", ["Panda", pytest.param("Gen3", marks=pytest.mark.nightly)])
def test_an_arm_from_a_file_goes_round_on_late_servos_and_becomes_c(
    arm: str,
    tmp_path: Path,
    built: Built,  # noqa: F811
) -> None:
    pytest.importorskip("mujoco")
    problem = problem_of(tmp_path, arm)
    by_plant = {plant: run_problem(load_problem(problem), plant=plant) for plant in (None, "mujoco")}
    for plant, outcome in by_plant.items():
        ((trace,), (scene,)) = outcome.traces.values(), outcome.scenes.values()
        # The seventh joint's own motion is kept from moving the hand where the arm would stop, not where it is.
        assert trace["position_error_m"].max() < (5e-5 if plant is None else 0.01)
        assert plant is None or trace["position_error_m"].max() > 1e-4  # it does move as something with a mass
        assert np.all((trace["joint"] >= scene.chain.lower) & (trace["joint"] <= scene.chain.upper))
    export_c(load_problem(problem), tmp_path / "c")
    assert largest_difference(tmp_path / "c", "pose_tracker", built) <= 1e-12


def test_an_arm_without_masses_or_efforts_is_refused_with_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"bodies.*masses of links"):
        own_arm_model(ur5())
    urdf, tip, _, _ = ARMS["Gen3"]
    (tmp_path / "gen3.urdf").write_text((ROBOTS / urdf).read_text().replace('effort="9"', 'effort="0"'))
    weak = SerialChain.from_urdf(tmp_path / "gen3.urdf", tip=tip, acceleration=5.0)
    with pytest.raises(ConfigurationError, match=r"effort of \S+ = inf: expected the drive's largest"):
        own_arm_model(weak)


def test_an_arm_from_an_mjcf_goes_round_within_its_force_ranges_or_those_of_its_robot_file(tmp_path: Path) -> None:
    """Its tip is a site."""
    pytest.importorskip("mujoco")
    bodies, drives = "", ""
    for i, axis in enumerate(("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")):
        bodies += (
            f'<body name="b{i}" pos="0 0 {0.1 if i != 2 else 0.3}"><joint name="j{i}" axis="{axis}" range="-170 170"/>'
        )
        bodies += f'<inertial pos="0 0 0.05" mass="{3.0 - 0.4 * i}" diaginertia="0.01 0.01 0.005"/>'
        drives += f'<motor joint="j{i}" ctrlrange="-1 1" gear="{60.0 - 8.0 * i}"/>'
    site = '<site name="grasp" pos="0 0 0.08"/>' + "</body>" * 6
    text = f"<mujoco><worldbody>{bodies}{site}</worldbody><actuator>{{}}</actuator></mujoco>"
    robot = 'mjcf = "arm.xml"\ntip = "grasp"\nacceleration_deg_s2 = 900.0\nspeed_deg_s = 180.0\n'
    (tmp_path / "circle.toml").write_text(CIRCLE.format(start=[0, 30, 60, 0, 70, 0]))
    for ranges, keys in (
        (drives, ""),
        ("", "".join(f"[joints.j{i}]\neffort_n_m = {60.0 - 8.0 * i}\n" for i in range(6))),
    ):
        (tmp_path / "arm.xml").write_text(text.format(ranges))
        (tmp_path / "robot.toml").write_text(robot + keys)
        outcome = run_problem(load_problem(str(tmp_path / "circle.toml")), plant="mujoco")
        assert dict(outcome.trace())["position_error_m"].max() < 0.01
    (tmp_path / "robot.toml").write_text(robot)
    with pytest.raises((ConfigurationError, ProblemFileError), match="effort_n_m"):
        run_problem(load_problem(str(tmp_path / "circle.toml")), plant="mujoco")
