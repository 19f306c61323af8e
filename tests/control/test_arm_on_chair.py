"""Any arm on a wheelchair: kinematics, masses and limits by the file's own origins and axes, without the package's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt import (
    DH,
    ConfigurationError,
    RedundancyResolver,
    SerialChain,
    Status,
    ardis,
    ur5,
)
from rehab_opt.kinematics.arm_links import maximise_hand_volume
from rehab_opt.kinematics.arm_on_chair import arm_on_chair
from rehab_opt.kinematics.mobile_arm import CHAIR
from tests.kinematics.robot_files.known_arms import gen3
from tests.kinematics.robot_files.random_arms import Edge, moving, pose_of, random_arm, urdf
from tests.refusals import refuses

Array = NDArray[np.float64]

DT = 0.01
MOUNT = np.eye(4)
MOUNT[:3, :3], MOUNT[:3, 3] = Rotation.from_euler("z", -0.4).as_matrix(), (0.25, -0.35, 0.62)


def arm_of(folder: Path, edges: list[Edge], **options: object) -> SerialChain:
    file = folder / "arm.urdf"
    file.write_text(urdf(edges))
    return SerialChain.from_urdf(file, tip=edges[-1].child, acceleration=4.0, **options)  # type: ignore[arg-type]


def chassis(q: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:2, 3] = Rotation.from_euler("z", q[2]).as_matrix(), q[:2]
    return pose


def link_pose(edges: list[Edge], q: Array, count: int) -> Array:
    """(4, 4) of the link that so many edges lead to, in the world."""
    return chassis(q) @ MOUNT @ pose_of(edges[:count], q[CHAIR : CHAIR + len(moving(edges[:count]))])


def turning_arm(seed: int) -> list[Edge]:
    rng = np.random.default_rng(seed)
    edges = random_arm(rng, 4 + seed % 4)
    for edge in edges:
        edge.kind = "revolute" if edge.kind == "prismatic" else edge.kind
    return edges


def test_a_link_heavier_than_the_chair_is_noted(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, turning_arm(0))
    links = [each._replace(mass=1500.0) if each.name == "link_2" else each for each in arm.bodies]
    said = arm_on_chair(replace(arm, bodies=tuple(links)), mount=MOUNT).chain.notes
    assert said == (*arm.notes, "link_2 of 1500 kg is heavier than the chair with its user")
    assert arm_on_chair(arm, mount=MOUNT).chain.notes == arm.notes


@pytest.mark.parametrize("seed", [0, 3])
def test_pose_and_energy_are_those_of_chair_and_links(tmp_path: Path, seed: int) -> None:
    edges, rng = turning_arm(seed), np.random.default_rng(seed)
    robot = arm_on_chair(arm_of(tmp_path, edges), mount=MOUNT, rotors=0.0, chair_mass=100.0, chair_turn_inertia=9.0)
    n, h = robot.chain.n, 1e-5
    q, v = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    np.testing.assert_allclose(robot.chain.pose(q), link_pose(edges, q, len(edges)), atol=1e-12)
    energy = 50.0 * (v[0] ** 2 + v[1] ** 2) + 4.5 * v[2] ** 2
    for i, edge in enumerate(edges):
        before, after = (link_pose(edges, q + t * v, i + 1) for t in (-h, h))
        speed = ((after - before) @ [*edge.centre, 1.0])[:3] / (2 * h)
        spin = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec() / (2 * h)  # in the link's axes
        turn = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
        spin = turn.T @ spin
        energy += edge.mass * speed @ speed / 2 + spin @ (edge.moments * spin) / 2
    assert v @ robot.inertia(q) @ v / 2 == pytest.approx(energy, rel=1e-6)


def test_the_chair_with_its_own_arm_is_as_it_was() -> None:
    robot = ardis()
    assert robot.reach == 0.45 + 0.50
    assert [(link.begin[0], link.end[0], link.radius) for link in robot.links] == [(4, 5, 0.05), (5, 7, 0.05)]
    found = maximise_hand_volume(robot.chain.with_limits(lower=-np.pi, upper=np.pi), first=CHAIR)
    assert found <= robot.hand_volume * (1 + 1e-9)  # type: ignore[operator]


def test_rows_that_no_posture_of_an_arm_can_do_are_refused(tmp_path: Path) -> None:
    edges, turns = gen3()[:4], ("rx", "ry", "rz")
    for edge, axis in zip(edges, ([0.0, 0.0, 1.0], *[[0.0, 1.0, 0.0]] * 3), strict=True):
        edge.xyz, edge.rpy, edge.axis = np.array([0.3, 0.0, 0.0]), np.zeros(3), np.array(axis)
    robot = arm_on_chair(arm_of(tmp_path, edges), mount=np.eye(4))
    for drive in ("fixed", "mecanum"):  # a shoulder that turns, and an arm that bends in its plane
        with pytest.raises(ConfigurationError, match=f"row_sets = .*: expected independent rows; .*{drive} base 2 of"):
            RedundancyResolver(robot, drive=drive, row_sets=[turns], compile=False)  # type: ignore[arg-type]
    RedundancyResolver(robot, drive="fixed", row_sets=[("x", "y", "z")], compile=False)


def test_an_arm_whose_links_all_lie_on_one_axis_has_no_link_that_moves_and_turns_its_hand() -> None:
    """A turntable on a column, which a chair carries about: its reach was a TypeError."""
    table = SerialChain([DH(0.0, 0.0, d=0.2)] * 4, lower=-2.0, upper=2.0, velocity=1.0, acceleration=4.0)
    robot = arm_on_chair(table, mount=MOUNT)
    assert robot.links == ()
    assert 0.6 <= robot.reach < 0.9
    control = RedundancyResolver(robot, row_sets=[("x", "y", "roll7")], dt=DT, compile=False)
    command, q = None, np.zeros(robot.chain.n)
    for _ in range(100):
        command = control.step(q, [0.1, 0.0, 0.3], ("x", "y", "roll7"))
        q = q + DT * command.value
    assert command is not None
    assert command.status is Status.OK
    assert q[CHAIR:].sum() > 0.1


def test_what_cannot_be_used_is_named(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, gen3())
    changes: list[tuple[str, Any, str]] = [
        ("mount", np.zeros((4, 4)), "mount"), ("chair_mass", -1.0, "chair_mass"), ("arm", None, "arm = None"),
        ("arm", ur5(), "bodies, rotors"), ("rotors", np.nan, "rotors"), ("rotors", "x", "rotors = 'x'"),
        ("rotors", [0.1, 0.2], "rotors = [0.1, 0.2]"), ("velocity", 1.0, "velocity = 1.0: expected two numbers"),
        ("velocity", ("a", "b"), "velocity = ('a', 'b')"), ("acceleration", None, "acceleration = None"),
        ("arm", arm_of(tmp_path, gen3()[:3]), "arm = 'joint_0 turns"),
    ]  # fmt: skip
    usual = {"arm": arm, "mount": MOUNT, "rotors": 0.0}
    refuses(arm_on_chair, *(({**usual, name: value}, words) for name, value, words in changes))
    turning = arm_of(tmp_path, turning_arm(0))
    bodies: list[tuple[str, Any, str]] = [
        ("inertia", np.diag([0.1, 0.1, 0.3]), "inertia of link_2 = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0],"),
        ("inertia", np.diag([-0.1, 0.1, 0.1]), "negative or above the other two together"),
        ("inertia", np.eye(3) + np.eye(3, k=1), "one that a body has"),
        ("inertia", np.full((3, 3), np.nan), "one that a body has"),
        ("inertia", "heavy", "inertia of link_2 = 'heavy'"),
        *(("mass", mass, "masses of 0 kg or more on links 1 to 7") for mass in (-1.0, np.nan, "1")),
    ]  # fmt: skip
    for name, value, words in bodies:
        links = [each._replace(**{name: value}) if each.name == "link_2" else each for each in turning.bodies]
        refuses(arm_on_chair, ({"arm": replace(turning, bodies=tuple(links)), "mount": MOUNT}, words))
