"""A robot of one's own stands wherever a problem file says ur5."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.qp_recording.recording import recorded_run
from rehab_opt import ProblemFileError, SerialChain, ur5
from rehab_opt.session.files import load_problem, shipped_problems
from rehab_opt.session.inputs import inputs_digest
from rehab_opt.session.report import write_report
from rehab_opt.session.robot_file import robot_at_start
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.systems import ROBOT_FILE, needed_files
from tests.kinematics.robot_files.known_arms import UR5_TOOL, gen3, vendors_ur5
from tests.kinematics.robot_files.random_arms import Edge, random_edge, urdf
from tests.refusals import refuses

PROBLEM = """
system = "pose_tracking"
title = "test"
[robot]
file = "robots/mine.toml"
start_deg = [0, 30, 180, -100, 0, -60, 90]
[circle]
radius_m = 0.01
duration_s = 1.0
[tracker]
rate_hz = 100.0
"""
MINE = """
urdf = "arm.urdf"
tip = "l6"
acceleration_deg_s2 = 900.0
"""
CAPSULE = """
[[capsules]]
link = "l3"
start_m = [0, 0, 0]
end_m = [0, -0.2, 0]
radius_m = 0.05
"""
UR5 = f"""
urdf = "arm.urdf"
acceleration_deg_s2 = {math.degrees(15.0)!r}
mount_deg = [0, 0, 180]
tool_m = {list(UR5_TOOL)}
tool_deg = [-90, 0, 0]
"""


@pytest.fixture
def problem(tmp_path: Path) -> Callable[..., str]:
    """Writes a problem, its robot file and URDF; the path of the first."""

    def write(mine: str = MINE, *, edges: list[Edge] | None = None, text: str = PROBLEM) -> str:
        (tmp_path / "robots").mkdir(exist_ok=True)
        (tmp_path / "robots" / "arm.urdf").write_text(urdf(gen3() if edges is None else edges))
        (tmp_path / "robots" / "mine.toml").write_text(mine)
        (tmp_path / "problem.toml").write_text(text)
        return str(tmp_path / "problem.toml")

    return write


def test_the_ur5_from_its_file_does_what_the_ur5_does(problem: Callable[..., str]) -> None:
    start = "start_deg = [0, -90, 90, -90, -90, 0]\n"
    lines = PROBLEM.splitlines(keepends=True)
    lines[5] = start
    own = run_problem(load_problem(problem(UR5, edges=vendors_ur5(), text="".join(lines))))
    shipped = run_problem(
        load_problem(problem(text="".join(lines).replace('file = "robots/mine.toml"', 'model = "ur5"')))
    )
    ((one,), (other,)) = own.traces.values(), shipped.traces.values()
    for column, least in (("reference", 1e-12), ("joint", 1e-9), ("command", 1e-8)):
        np.testing.assert_allclose(one[column], other[column], atol=least)
    assert set(one["status"]) == {"ok"}


def test_an_arm_of_ones_own_is_run_reported_and_recorded(problem: Callable[..., str], tmp_path: Path) -> None:
    config = load_problem(problem(MINE + "[joints.joint_2]\nlocked_deg = 180.0\n"))
    with pytest.raises(ProblemFileError, match="expected 6 entries, of joint_0, joint_1, joint_3"):
        checked(config)
    config = load_problem(problem())
    outcome = run_problem(config)
    assert next(iter(outcome.scenes.values())).chain.n == 7
    assert outcome.metrics["optimised"]["position_error_max_m"] < 1e-3
    files = write_report(outcome, tmp_path / "out")
    assert {file.suffix for file in files} == {".json", ".csv", ".png", ".pdf", ".md"}
    (sequence,) = recorded_run(config, ticks=5)
    assert sequence.name.endswith("pose_tracker")


def test_a_changed_urdf_is_another_problem(problem: Callable[..., str], tmp_path: Path) -> None:
    path = problem()
    before = inputs_digest(load_problem(path))
    assert inputs_digest(load_problem(path)) == before
    arm = tmp_path / "robots" / "arm.urdf"
    arm.write_text(arm.read_text().replace("0.21038", "0.21039"))
    assert inputs_digest(load_problem(path)) != before


def test_every_line_of_a_robot_file_counts(problem: Callable[..., str]) -> None:
    mine = MINE + """
    speed_deg_s = 100.0
    tool_m = [0.0, 0.0, 0.1]
    tool_deg = [0.0, 0.0, 90.0]
    mount_m = [1.0, 2.0, 3.0]
    payload_kg = 2.0
    [joints.joint_1]
    lower_deg = -60.0
    upper_deg = 60.0
    speed_deg_s = 20.0
    acceleration_deg_s2 = 50.0
    """ + CAPSULE  # fmt: skip
    robot, start = robot_at_start(load_problem(problem(mine)))
    bare, _ = robot_at_start(load_problem(problem()))
    tool = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    expected = bare.pose(start) @ tool
    expected[:3, 3] += [1, 2, 3]
    np.testing.assert_allclose(robot.pose(start), expected, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(robot.velocity), [100, 20, 100, 100, 100, 100, 100])
    np.testing.assert_allclose(np.rad2deg(robot.acceleration), [900, 50, 900, 900, 900, 900, 900])
    np.testing.assert_allclose(np.rad2deg([robot.lower[1], robot.upper[1]]), [-60, 60])
    assert [capsule.name for capsule in robot.capsules] == ["l3"]
    assert robot.bodies[-1].mass == 2.0


def test_the_problem_may_ask_for_less_than_the_robot_can_and_not_for_more(problem: Callable[..., str]) -> None:
    for given, speeds, acceleration in ((10.0, [10.0] * 7, 900.0), (170.0, [80.0] * 4 + [70.0] * 3, 900.0)):
        text = PROBLEM.replace("[circle]", f"joint_speed_deg_s = {given}\njoint_acceleration_deg_s2 = 5000.0\n[circle]")
        robot, _ = robot_at_start(load_problem(problem(text=text)))
        np.testing.assert_allclose(np.rad2deg(robot.velocity), speeds, atol=0.01)
        np.testing.assert_allclose(np.rad2deg(robot.acceleration), acceleration)


LIFT = random_edge(np.random.default_rng(1), "lift", "prismatic", "l6", "lifted")


def test_a_fault_of_a_robot_file_is_refused_with_its_key(problem: Callable[..., str]) -> None:
    refuses(
        lambda mine: checked(load_problem(problem(mine))),
        (("tip = 'l6'",), "acceleration_deg_s2 = None: expected this key"),
        ((MINE + "mjcf = 'a.xml'",), "urdf = 'arm.urdf': expected either urdf or mjcf"),
        ((MINE.replace("urdf = ", "mjcf = "),), "speed_deg_s = None: expected the joints' largest speed"),
        ((MINE.replace("l6", "hand"),), "arm.urdf: tip = 'hand': expected one of the links base, l0"),
        ((MINE.replace("arm.urdf", "none.urdf"),), "urdf = 'none.urdf': expected a file beside"),
        ((MINE + "[joints.elbow]\nlocked_deg = 3.0",), "joints.elbow.locked_deg = 3.0: expected a joint between"),
        ((MINE + "[joints.joint_1]\nlocked_deg = 300.0",), "joints.joint_1.locked_deg = 300.0: expected a value"),
        ((MINE + "[joints.joint_1]\nlocked_m = 0.1",), "joints.joint_1.locked_m = 0.1: expected an angle"),
        ((MINE + "[joints.joint_1]\nlocked_deg = 3.0\nlower_deg = 1.0",), "lower_deg = 1.0: expected no such key"),
        ((MINE + "[joints.joint_1]\nupper_deg = -175",), "upper_deg = -175.0: expected no less than limit.lower"),
        ((MINE + "[joints.j9]",), "joints = 'j9': expected joint names among"),
        ((MINE + "collision = true",), "collision = 'collision': expected <collision> in links between base and tip"),
        ((MINE + "a = [",), "line 5"),
        error=ProblemFileError,
    )
    edges, mine = [*gen3(), LIFT], MINE.replace("l6", "lifted")
    refuses(
        lambda more: checked(load_problem(problem(mine + more, edges=edges))),
        (("",), "joints.lift.locked_m = None: expected its locked position"),
        (("[joints.lift]\nlocked_deg = 30",), "lift.locked_deg = 30.0: expected metres: the joint slides"),
        error=ProblemFileError,
    )
    robot, _ = robot_at_start(load_problem(problem(mine + f"[joints.lift]\nlocked_m = {LIFT.upper}\n", edges=edges)))
    assert robot.n == 7


def test_a_hand_is_led_by_an_arm_from_a_file_as_by_the_ur5(problem: Callable[..., str], tmp_path: Path) -> None:
    path = Path(problem(UR5, edges=vendors_ur5()))
    shipped = shipped_problems()["mirror/pick_fruit"]
    for name in ("pick_fruit.csv", "calibration_points.csv"):
        (tmp_path / name).write_bytes((shipped.parent / name).read_bytes())
    text = shipped.read_text().replace('model = "ur5"', 'file = "robots/mine.toml"')
    path.write_text(text)
    from rehab_opt.session.mirror.scene import laid_out  # noqa: PLC0415  (loads solvers)

    scene = laid_out(load_problem(str(path)))
    same = laid_out(load_problem("mirror/pick_fruit"))
    assert isinstance(scene.robot, SerialChain)
    np.testing.assert_allclose(scene.robot.pose(scene.start), ur5().pose(same.start), atol=1e-12)
    needed = needed_files(load_problem(str(path)).problem)
    assert ROBOT_FILE in [each.key for each in needed]
