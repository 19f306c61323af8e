"""An arm of a robot file on a chair, from problem file to report; the shipped robots are what their sources say."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt import ProblemFileError, SerialChain
from rehab_opt.session.ardis.clearance import arm_gaps, arm_points
from rehab_opt.session.ardis.robot import robot_of, start_of
from rehab_opt.session.files import load_problem, shipped_folder
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.run import run_problem
from tests.control.redundancy_campaign import segment_distance
from tests.kinematics.robot_files.known_arms import gen3
from tests.kinematics.robot_files.random_arms import pose_of
from tests.refusals import refuses

Array = NDArray[np.float64]
Changed = Callable[..., str]
ROBOTS = shipped_folder() / "robots"
GEN3, PANDA = ROBOTS / "kinova_gen3/gen3.urdf", ROBOTS / "franka_panda/panda.urdf"
# Craig's (modified) parameters of the Franka Control Interface's documentation: a [m], d [m], alpha; then the flange.
PANDA_DH = (
    (0, 0.333, 0), (0, 0, -90), (0, 0.316, 90), (0.0825, 0, 90), (-0.0825, 0.384, -90), (0, 0, 90), (0.088, 0, 90),
)  # fmt: skip
FLANGE = 0.107
MOUNT = np.eye(4)
MOUNT[:3, 3] = 0.30, -0.32, 0.55
OURS = ("fixed", "optimised")


@pytest.fixture(scope="module")
def drink() -> Outcome:
    outcome = run_problem(load_problem("ardis/kinova_drink"))
    return outcome


@pytest.fixture
def changed(tmp_path: Path) -> Changed:
    """The drinking problem with one text in place of another, in the problem, its robot file or its URDF."""

    def write(file: str, old: str, new: str) -> str:
        for folder in ("ardis", "robots"):
            shutil.copytree(shipped_folder() / folder, tmp_path / folder, dirs_exist_ok=True)
        path = tmp_path / file
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))
        return str(tmp_path / "ardis/kinova_drink.toml")

    return write


def links_of(urdf: Path, q: Array) -> dict[str, Array]:
    """(4, 4) of each link by its name, multiplied out of the file's own origins."""
    poses, values = {}, iter(q)
    for joint in ET.parse(urdf).getroot().iter("joint"):
        parent, child = (joint.find(end).attrib["link"] for end in ("parent", "child"))  # type: ignore[union-attr]
        origin = joint.find("origin").attrib  # type: ignore[union-attr]
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler("xyz", [float(each) for each in origin["rpy"].split()]).as_matrix()
        step[:3, 3] = [float(each) for each in origin["xyz"].split()]
        if joint.attrib["type"] != "fixed":
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_euler("z", next(values)).as_matrix()
            step = step @ turn
        poses[child] = poses.get(parent, np.eye(4)) @ step
    return poses


def test_the_gen3_is_the_vendors_but_for_its_rounding() -> None:
    chain, rng = SerialChain.from_urdf(GEN3, tip="bracelet_link", acceleration=2.0), np.random.default_rng(0)
    edges = gen3()
    for q in rng.uniform(-2, 2, (50, 7)):
        np.testing.assert_allclose(chain.pose(q)[:3, 3], pose_of(edges, q)[:3, 3], atol=3e-5)
    np.testing.assert_array_equal(chain.upper[1::2], [edge.upper for edge in edges[1::2]])
    assert np.all(np.isinf(chain.upper[::2]))
    np.testing.assert_array_equal(chain.velocity, [edge.velocity for edge in edges])


def test_the_panda_is_that_of_its_documented_parameters() -> None:
    chain, rng = SerialChain.from_urdf(PANDA, acceleration=7.5), np.random.default_rng(0)
    for q in rng.uniform(chain.lower, chain.upper, (50, 7)):
        pose = np.eye(4)
        for (a, d, alpha), angle in zip(PANDA_DH, q, strict=True):
            before, after = np.eye(4), np.eye(4)
            before[:3, :3], before[0, 3] = Rotation.from_euler("x", alpha, degrees=True).as_matrix(), a
            after[:3, :3], after[2, 3] = Rotation.from_euler("z", angle).as_matrix(), d
            pose = pose @ before @ after
        pose[:3, 3] += FLANGE * pose[:3, 2]
        np.testing.assert_allclose(chain.pose(q), pose, atol=1e-12)


def test_the_cup_is_brought_to_the_mouth_level_and_within_every_limit(drink: Outcome) -> None:
    ours, theirs = (drink.metrics["drives"]["fixed"][law] for law in ("optimised", "published"))
    assert ours["goals_met"] == len(drink.scenes[OURS].problem.goals) == 5
    assert ours["broken_any_fraction"] == 0.0
    assert set(ours["status"]) == {"ok"}
    assert ours["rolling_residual_max_m_s"] == 0.0
    assert theirs["goals_met"] == 5
    assert theirs["broken_fraction"]["acceleration"] > 0.001
    trace = drink.traces[OURS]
    assert np.all(trace["joint"][:, :3] == 0.0)
    cups = trace["pose"][:, :3, :3] @ trace["pose"][0, :3, :3].T @ [0.0, 0.0, 1.0]
    tilt = np.rad2deg(np.arcsin(np.linalg.norm(cups[:, :2], axis=1)))
    assert tilt.max() < 0.01
    assert ours["hand_tilt_max_deg"] == pytest.approx(tilt.max(), abs=1e-6)


def test_distances_of_an_arm_of_capsules_are_those_of_its_files(drink: Outcome) -> None:
    robot, q = drink.scenes[OURS].robot, drink.traces[OURS]["joint"][::400]
    ends = {
        "half_arm_1_link": ((0, -0.42, -0.012), 0.055),
        "forearm_link": ((0, -0.314, -0.006), 0.05),
        "spherical_wrist_2_link": ((0, -0.287, 0), 0.05),
    }
    for posture, gaps, points in zip(q, arm_gaps(robot, q), arm_points(robot, q), strict=True):
        links = links_of(GEN3, posture[3:])
        expected = []
        for capsule in robot.keep_out:
            for name, (end, radius) in ends.items():
                pose = MOUNT @ links[name]
                apart = segment_distance(pose[:3, 3], (pose @ [*end, 1.0])[:3], capsule)
                expected.append(apart - capsule.radius - radius)
        np.testing.assert_allclose(gaps, expected, atol=1e-9)
        hand = MOUNT @ links["end_effector_link"] @ [0.0, 0.0, 0.12, 1.0]
        np.testing.assert_allclose(points[-1], hand[:3], atol=1e-9)
        np.testing.assert_allclose(points[0], (MOUNT @ links["shoulder_link"])[:3, 3], atol=1e-9)


def read_and_used(file: str) -> None:
    """Cheapest first: a controller is made where all else is right."""
    config = load_problem(file)
    start_of(config, robot_of(config))
    run_problem(config)


PROBLEM, ROBOT, URDF = "ardis/kinova_drink.toml", "robots/kinova_gen3/on_chair.toml", "robots/kinova_gen3/gen3.urdf"

MOVING = """[[clearance.moving]]
name = "tray"
start_m = [2.0, 0.0, 0.0]
radius_m = 0.1
towards_m = [0.0, 1.0, 0.0]
period_s = 4.0
"""


def test_a_fault_names_file_joint_key_value_and_what_was_expected(changed: Changed) -> None:
    refuses(
        lambda file, old, new: read_and_used(changed(file, old, new)),
        ((PROBLEM, "arm_deg = [-105.9, ", "arm_deg = ["), "robot.arm_deg = "),
        ((PROBLEM, "-72.0", "-172.0"), "robot.arm_deg.1 = -172.0: expected joint_2 within"),
        ((PROBLEM, "arm_deg = ", "# "), "robot.arm_deg = None: expected where the arm"),
        (
            (PROBLEM, "arm_deg = ", "payload_kg = 1.0\narm_deg = "),
            "robot.payload_kg = 1.0: expected no such key beside",
        ),
        ((PROBLEM, "on_chair.toml", "none.toml"), "kinova_gen3/none.toml': expected a robot file"),
        ((PROBLEM, "[robot]", 'robot = "ardis"\n[run]'), "robot = 'ardis': expected a table of keys"),
        ((PROBLEM, 'held = ["y", "rx", "ry"]', 'held = ["x", "rx", "ry"]'), "stick.modes.0.held = "),
        ((PROBLEM, 'simulated = ["fixed"]', 'tracks = "s.csv"'), "stick.tracks = 's.csv': expected one of the keys"),
        ((PROBLEM, "[stick]", f"{MOVING}[stick]"), "clearance.moving = ['tray']: expected none: bodies that move"),
        ((ROBOT, "[[caps", "[joints.joint_1]\nlower_deg = -90.0\n[[caps"), "on_chair.toml: joint joint_1, lower"),
        ((ROBOT, 'tip = "end_effector_link"', 'tip = "half_arm_2_link"'), "4 or more joints"),
        ((URDF, 'velocity="1.3963"', 'velocity="-1"'), "gen3.urdf: joint joint_1, limit.velocity = -1.0: expected"),
        ((URDF, 'xyz="0 0 1"', 'xyz="0 0 2"'), "gen3.urdf: joint joint_1, axis.xyz = '0 0 2': expected a vector of"),
        error=ProblemFileError,
    )


def test_what_stands_is_no_room_of_what_moves(drink: Outcome) -> None:
    chain, world = drink.scenes[OURS].chain, drink.traces[OURS]["_world"]
    room = np.min(chain.velocity[3:] - np.abs(world[:, 3:]))
    assert room > chain.velocity[0]  # the standing chair's, smaller here
    assert drink.metrics["drives"]["fixed"]["optimised"]["excess_max"]["velocity"] == pytest.approx(-room, abs=1e-12)
