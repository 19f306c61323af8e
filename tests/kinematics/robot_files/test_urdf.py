"""A chain from a URDF moves as the file says: random arms against plain numpy and against MuJoCo's reading of them."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt import ConfigurationError, SerialChain, ur5
from rehab_opt.errors import RobotFileError
from rehab_opt.kinematics.inertia import inertia_expression
from rehab_opt.kinematics.link_capsules import CapsuleOnLink
from tests.kinematics.dh_oracle import differentiated
from tests.kinematics.robot_files.known_arms import UR5_TOOL, gen3, vendors_ur5
from tests.kinematics.robot_files.random_arms import (
    KINDS,
    Edge,
    moving,
    pose_of,
    random_arm,
    random_edge,
    random_postures,
    urdf,
)

Array = NDArray[np.float64]


@pytest.fixture
def arm_file(tmp_path: Path) -> Path:
    return tmp_path / "arm.urdf"


def read(file: Path, edges: list[Edge], **options: object) -> SerialChain:
    file.write_text(urdf(edges))
    return SerialChain.from_urdf(file, **{"acceleration": 10.0, "tip": edges[-1].child, **options})


def frames_of(chain: SerialChain, q: Array) -> list[Array]:
    return [np.array(ca.DM(frame)) for frame in chain.frames_expression(ca.SX(q))]


# --------------------------------------------------------------------------------------------------- kinematics
@pytest.mark.parametrize("seed", range(15))
def test_random_arms_and_a_known_one_move_as_their_files_say(arm_file: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = gen3() if seed == 0 else random_arm(rng, int(rng.integers(1, 10)))
    chain = read(arm_file, edges)
    assert chain.names == tuple(edge.name for edge in moving(edges))
    for q in random_postures(edges, rng, 20):
        np.testing.assert_allclose(chain.pose(q), pose_of(edges, q), atol=1e-12)
    np.testing.assert_allclose(chain.jacobian(q), differentiated(chain, q), atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_masses_give_the_inertia_that_mujoco_has(arm_file: Path, seed: int) -> None:
    """Those of links that are carried aside too, behind the tip and within trees; joints of their own are at zero."""
    rng = np.random.default_rng(200 + seed)
    edges = random_arm(rng, 4)
    aside = list[Edge]()
    for i in range(0 if seed == 0 else int(rng.integers(1, 9))):
        parent = str(rng.choice(["base", *(edge.child for edge in (*edges, *aside))]))
        aside.append(random_edge(rng, f"own_{i}", str(rng.choice(KINDS)), parent, f"aside_{i}"))
    together = [*edges, *aside]
    rng.shuffle(together)
    arm_file.write_text(urdf(together))
    chain = SerialChain.from_urdf(arm_file, acceleration=10.0, tip=edges[-1].child)
    text = urdf(together).replace("<visual>", "<!--").replace("</visual>", "-->")
    text = text.replace('<robot name="random">', '<robot name="random"><mujoco><compiler fusestatic="false"/></mujoco>')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    at = [model.joint(edge.name).id for edge in moving(edges)]
    data.qpos[at] = q = random_postures(edges, rng, 1)[0]
    mujoco.mj_forward(model, data)
    expected = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, expected)
    found = np.array(ca.DM(inertia_expression(chain, chain.bodies, np.zeros(4), ca.SX(q))))
    np.testing.assert_allclose(found, expected[np.ix_(at, at)], atol=1e-9)
    said = {note.split()[1] for note in chain.notes if "is not between base and tip" in note}
    assert said <= {edge.name for edge in moving(aside)}
    assert all(each.link > 0 or "aside" not in each.name for each in chain.bodies)


def test_what_a_link_carries_aside_has_its_capsules(arm_file: Path) -> None:
    rng = np.random.default_rng(31)
    edges = random_arm(rng, 3)
    camera = random_edge(rng, "holder", "fixed", edges[-1].child, "camera")
    ball = '<collision><geometry><sphere radius="0.04"/></geometry></collision>'
    arm_file.write_text(urdf([*edges, camera]).replace('<link name="camera">', f'<link name="camera">{ball}'))
    options = {"acceleration": 10.0, "tip": edges[-1].child}
    chain = SerialChain.from_urdf(arm_file, capsules="collision", **options)
    own = SerialChain.from_urdf(arm_file, capsules=[CapsuleOnLink("camera", (0, 0, 0), (0, 0, 0), 0.04)], **options)
    for each in (chain, own):
        (capsule,) = each.capsules
        for q in random_postures(edges, rng, 5):
            at = (frames_of(each, q)[capsule.frame] @ [*capsule.start, 1.0])[:3]
            np.testing.assert_allclose(at, pose_of([*edges, camera], q)[:3, 3], atol=1e-12)
        assert capsule.radius == 0.04
    mesh = '<collision><geometry><mesh filename="a.stl"/></geometry></collision>'
    arm_file.write_text(arm_file.read_text().replace(ball, ball + mesh))
    (note,) = SerialChain.from_urdf(arm_file, capsules="collision", **options).notes
    assert note.startswith("link camera, collision.mesh = a.stl: nothing is kept clear of it")


@pytest.mark.parametrize("seed", range(6))
def test_origins_turned_by_quaternions_are_those_turned_by_angles(arm_file: Path, seed: int) -> None:
    rng = np.random.default_rng(300 + seed)
    edges = random_arm(rng, 6)
    turned = read(arm_file, edges)
    text = arm_file.read_text().replace("<robot ", '<robot version="1.1" ')

    def as_quaternion(found: re.Match[str]) -> str:
        x, y, z, w = Rotation.from_euler("xyz", [float(each) for each in found[1].split()]).as_quat() * rng.choice(
            [-1, 1]
        )
        return f'quat_xyzw="{x!r} {y!r} {z!r} {w!r}"'.replace("np.float64(", "").replace(")", "")

    text, count = re.subn(r'rpy="([^"]*)"', as_quaternion, text)
    assert count > 6
    arm_file.write_text(text)
    chain = SerialChain.from_urdf(arm_file, acceleration=10.0, tip=edges[-1].child)
    assert chain.notes == turned.notes
    for q in random_postures(edges, rng, 20):
        np.testing.assert_allclose(chain.pose(q), turned.pose(q), atol=1e-12)
    inertia = [
        np.array(ca.DM(inertia_expression(each, each.bodies, np.zeros(6), ca.SX(q)))) for each in (chain, turned)
    ]
    np.testing.assert_allclose(*inertia, atol=1e-12)


def test_ur5_from_a_file_is_the_ur5_of_this_library(arm_file: Path) -> None:
    tool = np.eye(4)
    tool[:3, :3], tool[:3, 3] = Rotation.from_euler("x", -np.pi / 2).as_matrix(), UR5_TOOL
    chain, ours = read(arm_file, vendors_ur5(), mount=np.diag([-1.0, -1.0, 1.0, 1.0]), tool=tool), ur5()
    for q in np.random.default_rng(0).uniform(-3, 3, (50, 6)):
        np.testing.assert_allclose(chain.pose(q), ours.pose(q), atol=1e-12)
        np.testing.assert_allclose(chain.jacobian(q), ours.jacobian(q), atol=1e-12)
        assert chain.manipulability(q) == pytest.approx(ours.manipulability(q), abs=1e-13)


def test_a_locked_joint_stays_where_it_is_and_is_no_joint(arm_file: Path) -> None:
    edges = random_arm(np.random.default_rng(6), 5)
    assert {held.kind for held in moving(edges)} == {"revolute", "continuous", "prismatic"}
    for i, held in enumerate(moving(edges)):
        value = 0.3 if held.kind == "continuous" else (held.lower + held.upper) / 2
        chain = read(arm_file, edges, locked={held.name: value})
        assert chain.n == 4
        assert any(f"joint {held.name} is locked at {value:.6g}" in note for note in chain.notes)
        q = np.linspace(-1, 1, 4)
        np.testing.assert_allclose(chain.pose(q), pose_of(edges, np.insert(q, i, value)), atol=1e-12)


def test_a_coupled_joint_is_ignored_beside_the_chain_and_refused_on_it(arm_file: Path) -> None:
    rng = np.random.default_rng(7)
    edges = random_arm(rng, 3)
    finger = random_edge(rng, "finger", "prismatic", edges[-1].child, "finger_link")
    finger.extra = f'<mimic joint="{edges[0].name}" multiplier="-1"/>'
    arm_file.write_text(urdf([*edges, finger]))
    assert "finger" not in SerialChain.from_urdf(arm_file, tip=edges[-1].child, acceleration=1.0).names
    with pytest.raises(RobotFileError, match=r"joint finger, mimic\.joint = .*lock it"):
        SerialChain.from_urdf(arm_file, tip="finger_link", acceleration=1.0)
    assert SerialChain.from_urdf(arm_file, tip="finger_link", acceleration=1.0, locked={"finger": finger.upper}).n == 3


def test_limits_are_the_files_unless_given(arm_file: Path) -> None:
    edges = gen3()
    chain = read(arm_file, edges)
    assert chain.lower.tolist() == [-np.inf, -2.41, -np.inf, -2.66, -np.inf, -2.23, -np.inf]
    assert chain.velocity.tolist() == [edge.velocity for edge in edges]
    assert chain.acceleration.tolist() == [10.0] * 7
    other = read(arm_file, edges, velocity={"joint_2": 0.5}, upper=1.0, acceleration=dict.fromkeys(chain.names, 3.0))
    assert other.velocity[2] == 0.5
    assert other.velocity[3] == edges[3].velocity
    assert other.upper.tolist() == [1.0] * 7


def test_infinite_limits_of_a_file_are_none(tmp_path: Path) -> None:
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child '
        'link="b"/><origin xyz="0.3 0 0"/><limit lower="-inf" upper="Infinity" velocity="1" effort="INF"/></joint>'
        "</robot>"
    )
    (tmp_path / "a.urdf").write_text(text)
    arm = SerialChain.from_urdf(tmp_path / "a.urdf", acceleration=2.0)
    assert (arm.lower[0], arm.upper[0], arm.effort[0], arm.notes) == (-np.inf, np.inf, np.inf, ())
    for wrong in (text.replace('"-inf"', '"nan"'), text.replace('"-inf"', '"inf" x=""'), text.replace('"1"', '"inf"')):
        (tmp_path / "a.urdf").write_text(wrong)
        with pytest.raises(RobotFileError, match=r"limit\."):
            SerialChain.from_urdf(tmp_path / "a.urdf", acceleration=2.0)


def test_capsules_about_collision_geometry_hold_all_of_it(arm_file: Path) -> None:
    rng = np.random.default_rng(11)
    shapes = {
        "box": (lambda a, b, c: f'<box size="{a} {b} {c}"/>', lambda a, b, c: np.array([a, b, c]) / 2),
        "cylinder": (lambda a, b, c: f'<cylinder radius="{a}" length="{c}"/>', lambda a, b, c: np.array([a, a, c / 2])),
        "sphere": (lambda a, b, c: f'<sphere radius="{a}"/>', lambda a, b, c: np.array([a, a, a])),
    }
    for name, (written, halves) in shapes.items():
        sizes, xyz, rpy = rng.uniform(0.05, 0.4, 3), rng.uniform(-0.3, 0.3, 3), rng.uniform(-3, 3, 3)
        origin = '<origin xyz="{} {} {}" rpy="{} {} {}"/>'.format(*xyz, *rpy)
        geometry = f"<collision>{origin}<geometry>{written(*sizes)}</geometry></collision>"
        arm_file.write_text(
            urdf(random_arm(rng, 3)).replace('<link name="base"/>', f'<link name="base">{geometry}</link>')
        )
        chain = SerialChain.from_urdf(arm_file, acceleration=1.0, capsules="collision")
        (capsule,) = chain.capsules
        assert (capsule.name, capsule.frame) == ("base", 0)
        points = rng.uniform(-1, 1, (2000, 3))
        if name != "box":
            points[:, :2] /= np.maximum(np.linalg.norm(points[:, :2], axis=1, keepdims=True), 1)
        if name == "sphere":
            points /= np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1)
        frame = chain.base
        there = points * halves(*sizes) @ Rotation.from_euler("xyz", rpy).as_matrix().T + xyz
        a, b = (frame[:3, :3] @ each + frame[:3, 3] for each in (np.array(capsule.start), np.array(capsule.end)))
        way = (b - a) / max(float(np.sum((b - a) ** 2)), 1e-12)
        along = np.clip((there - a) @ way, 0, 1)[:, None]
        apart = np.linalg.norm(there - a - along * (b - a), axis=1)
        assert 0.8 * capsule.radius < apart.max() <= capsule.radius + 1e-12
    arm_file.write_text(urdf(random_arm(rng, 3)).replace('<link name="base"/>', MESHED))
    with pytest.raises(
        RobotFileError, match=r"link base, collision.mesh = 'package://a.stl': expected sphere, cylinder"
    ):
        SerialChain.from_urdf(arm_file, acceleration=1.0, capsules="collision")
    assert not SerialChain.from_urdf(arm_file, acceleration=1.0).capsules


MESHED = '<link name="base"><collision><geometry><mesh filename="package://a.stl"/></geometry></collision></link>'


def test_what_is_off_by_rounding_is_corrected_and_noted(arm_file: Path) -> None:
    edges = [edge for edge in random_arm(np.random.default_rng(10), 2) if edge.kind != "fixed"]
    edges[0].parent, edges[1].parent = "base", edges[0].child
    edges[0].kind, edges[0].axis = "revolute", np.array([0.5774, 0.5774, 0.5774])
    tool = np.eye(4)
    tool[:2, :2] = [[0.7071, -0.7071], [0.7071, 0.7071]]
    chain = read(arm_file, edges, tool=tool)
    assert [note.partition(" is off by")[0] for note in chain.notes] == [
        f"joint {edges[0].name}, axis.xyz: the length",
        "tool: the rotation",
    ]
    assert "8.6e-05" in chain.notes[0]
    np.testing.assert_allclose(chain.tool[:3, :3] @ chain.tool[:3, :3].T, np.eye(3), atol=1e-15)
    again = pickle.loads(pickle.dumps(chain))
    np.testing.assert_array_equal(again.pose([0.1, 0.2]), chain.pose([0.1, 0.2]))
    with pytest.raises(ValueError, match="read-only"):
        again.rows[0].after[0, 0] = 2.0
    edges[0].axis = np.array([0.577, 0.577, 0.58])
    with pytest.raises(RobotFileError, match=r"axis\.xyz = '0\.577 0\.577 0\.58': expected .* length is 1\.00113"):
        read(arm_file, edges)
    tool[0, 0] = 0.8
    with pytest.raises(ConfigurationError, match="off by"):
        read(arm_file, random_arm(np.random.default_rng(10), 2), tool=tool)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</robot>", '<Joint name="x"/></robot>', "line 1: <Joint> is not read"),
        ("<link name=\"b\"/>", '<link name="b"><Inertial/></link>', "link b: <Inertial> is not read"),
        ("<link name=\"b\"/>", '<link name="b"><visual><geom/></visual></link>', "link b, visual: <geom> is not read"),
        ("<link name=\"b\"/>", '<link name="b"><inertial><mass value="1"/></inertial></link>',
         "link b, inertial: mass and inertia are read together alone; the link has none"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><dynamics damping="1"/>', "joint j: <dynamics> is not read"),
        ("</robot>", '<gazebo><plugin/></gazebo><transmission/><ros2_control/><material name="m"/></robot>', None),
    ],
)  # fmt: skip
def test_elements_that_are_not_read_are_noted(tmp_path: Path, old: str, new: str, said: str | None) -> None:
    """Wherever in the file they are."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    file = tmp_path / "arm.urdf"
    file.write_text(text.replace(old, new))
    notes = SerialChain.from_urdf(file, acceleration=1.0, velocity=1.0).notes
    assert notes == (() if said is None else (said,))
