"""What is wrong with a robot file is said in two lines: file, joint, key, value, what was expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import CapsuleOnLink, ConfigurationError, ProblemFileError, SerialChain
from rehab_opt.errors import RobotFileError
from tests.kinematics.robot_files.random_arms import random_arm, urdf


@pytest.fixture
def good(tmp_path: Path) -> Callable[..., Path]:
    """Writes an arm of two joints, joint_a and joint_b, with something replaced in it."""

    def write(old: str = "", new: str = "") -> Path:
        joint = (
            '<joint name="joint_{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
            '<origin xyz="0 0 0.3" rpy="0 1.5708 0"/><axis xyz="0 1 0"/>'
            '<limit lower="-2" upper="2" velocity="1.5" effort="9"/></joint>'
        )
        text = '<robot name="good"><link name="base"/><link name="middle"/><link name="hand"/>'
        text += joint.format("a", "base", "middle") + joint.format("b", "middle", "hand") + "</robot>"
        assert old in text
        file = tmp_path / "arm.urdf"
        file.write_text(text.replace(old, new, 1) if old else text)
        return file

    return write


def refusal(file: Path, **options: object) -> str:
    with pytest.raises((ProblemFileError, ConfigurationError)) as caught:
        SerialChain.from_urdf(file, **{"acceleration": 1.0, **options})  # type: ignore[arg-type]
    said = str(caught.value)
    assert len(said) <= 2 * 200
    assert "\n" not in said
    return said


@pytest.mark.parametrize(
    ("old", "new", "key", "value", "expected"),
    [
        ('xyz="0 1 0"', 'xyz="0 0 0"', "joint joint_a, axis.xyz", "'0 0 0'", "length 1"),
        ('xyz="0 1 0"', 'xyz="1 1 0"', "joint joint_a, axis.xyz", "'1 1 0'", "its length is 1.41421"),
        ('xyz="0 1 0"', "", "joint joint_a, axis.xyz", "None", "three numbers"),
        ('xyz="0 0 0.3"', 'xyz="0 0 inf"', "joint joint_a, origin.xyz", "'0 0 inf'", "3 finite numbers"),
        ('xyz="0 0 0.3"', 'xyz="0 0 300"', "joint joint_a, origin.xyz", "'0 0 300'", "another unit?"),
        ('rpy="0 1.5708 0"', 'rpy="0 90 0"', "joint joint_a, origin.rpy", "'0 90 0'", "another unit?"),
        ('lower="-2"', 'lower="-114"', "joint joint_a, limit.lower", "-114.0", "radians within two turns"),
        ('upper="2"', 'upper="-3"', "joint joint_a, limit.lower", "-2.0", "no more than limit.upper = -3"),
        ('velocity="1.5"', 'velocity="0"', "joint joint_a, limit.velocity", "0.0", "a speed above 0 rad/s"),
        ('lower="-2" upper="2"', "", "joint joint_a, limit.lower", "None", "give lower="),
        ('type="revolute"', 'type="Revolute"', "joint joint_a, type", "'Revolute'", "or fixed, such as 'revolute'"),
        ('name="joint_b"', 'name="joint_a"', "line 1, joint.name", "'joint_a'", "no other joint"),
        ('link name="hand"', 'link name="middle"', "line 1, link.name", "'middle'", "no other link"),
        ('<link name="middle"/>', "", "joint joint_a, child.link", "'middle'", "a link of this file"),
        ('<parent link="base"', '<parent link="middle"', "joint joint_a, child.link", "'middle'", "than its parent"),
        ('<parent link="base"/>', '<parent link="hand"/>', "joint joint_b, child.link", "'hand'", "below itself"),
        ('<child link="hand"/>', '<child link="middle"/>', "joint joint_b, child.link", "'middle'", "one parent"),
        ("<axis", "<origin/><axis", "joint joint_a, origin", "'2 elements'", "one"),
        ('<link name="base"/>', '<link name="base"/><xacro:a/>', "line 1", "'<xacro:a>'", "> arm_expanded.urdf"),
        ('lower="-2"', 'lower="${-2}"', "line 1, limit.lower", "'${-2}'", "> arm_expanded.urdf"),
        ('rpy="0 1.5708 0"', 'quat_xyzw="0 0 0 1"', "joint joint_a, origin.quat_xyzw", "'0 0 0 1'", "in version 1.0"),
    ],
)  # fmt: skip
def test_a_bad_value_is_named_with_its_joint_and_key(
    good: Callable[..., Path], old: str, new: str, key: str, value: str, expected: str
) -> None:
    file = good(old, new)
    said = refusal(file, tip="hand") if "joint_b" not in old else refusal(file)
    if old == "joint_b":
        old = 'name="joint_b"'
    assert said.startswith(f"{file}: {key}")
    where = [said.index(part) for part in (key, value, "expected", expected)]
    assert where == sorted(where)


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        ('quat_xyzw="0 0.6 0 0.9"', "= '0 0.6 0 0.9': expected a vector of length 1 (its length is 1.08167)"),
        ('quat_xyzw="0 0 1"', "= '0 0 1': expected 4 finite numbers"),
        ('rpy="0 0 0" quat_xyzw="0 0 0 1"', "= '0 0 0 1': expected no rpy beside it: either says how it is turned"),
    ],
)
def test_a_quaternion_that_is_none_is_refused(good: Callable[..., Path], turn: str, expected: str) -> None:
    file = good('rpy="0 1.5708 0"', turn)
    file.write_text(file.read_text().replace("<robot ", '<robot version="1.1" ', 1))
    assert refusal(file) == f"{file}: joint joint_a, origin.quat_xyzw {expected}"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"tip": "nowhere"}, "tip = 'nowhere': expected one of the links base, middle, hand"),
        ({"base": "hand", "tip": "middle"}, "tip = 'middle': expected a link below base = 'hand'"),
        ({"base": "hand"}, "base = 'hand': expected a link that bears others"),
        ({"locked": None}, "locked = None: expected joint values by joint name"),
        ({"capsules": "collision"}, "arm.urdf has none"),
        ({"capsules": [CapsuleOnLink("hand", (0, 0, 0), (0, 0, 1), -0.1)]}, "capsules[0].radius = -0.1: expected 0 m"),
        ({"lower": {"joint_a": 5.0}}, "lower['joint_a'] = 5.0: expected no more than limit.upper of "),
        ({"lower": 1.0, "upper": 0.5}, "upper['joint_a'] = 0.5: expected no less than lower, 1 rad"),
        ({"tip": "base"}, "tip = 'base': expected a link that joints move against the base"),
        ({"locked": {"joint_c": 1.0}}, "locked = 'joint_c'"),
        ({"locked": {"joint_a": np.nan}}, "locked['joint_a'] = nan"),
        ({"locked": {"joint_a": 2.5}}, "locked['joint_a'] = 2.5: expected a value within the joint's -2 to 2 rad"),
        ({"acceleration": [1.0, 2.0, 3.0]}, "acceleration = [1.0, 2.0, 3.0]"),
        ({"acceleration": "fast"}, "acceleration = 'fast'"),
        ({"velocity": -1.0}, "velocity['joint_a'] = -1.0: expected a speed above 0 rad/s"),
    ],
)
def test_a_bad_argument_is_named(good: Callable[..., Path], options: dict[str, object], expected: str) -> None:
    assert expected in refusal(good(), **options)


def test_what_is_not_read_and_what_no_body_has_is_noted(good: Callable[..., Path]) -> None:
    heavy = (
        '<link name="middle"><inertial><mass value="2"/>'
        '<inertia ixx="{0}" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    for xx, noted in ((0.02, False), (0.021, True), (-0.01, True), (0.0, False)):
        arm = SerialChain.from_urdf(good('<link name="middle"/>', heavy.format(xx)), acceleration=1.0)
        assert arm.notes == (("link middle, inertia: no body has it; robots with mass refuse it",) if noted else ())
    assert SerialChain.from_urdf(good("<axis", "<Axis"), acceleration=1.0).notes == (
        "joint joint_a: <Axis> is not read",
    )
    for old, new, said in (
        ('rpy="0 1.5708 0"', 'RPY="0 1.5708 0"', "joint joint_a: origin.RPY is not read"),
        ('velocity="1.5"', 'velocity="1.5" acceleration="3"', "joint joint_a: limit.acceleration is not read"),
        ('type="revolute"><parent', 'type="fixed"><Origin/><parent', "joint joint_a: <Origin> is not read"),
    ):
        assert SerialChain.from_urdf(good(old, new), acceleration=1.0).notes == (said,)
    endless = SerialChain.from_urdf(good('"revolute"', '"continuous"'), acceleration=1.0)
    assert np.isinf(endless.upper[0])
    assert endless.notes == tuple(f"joint joint_a: limit.{key} is not read" for key in ("lower", "upper"))


def test_degrees_for_radians_in_arguments_are_noted_where_they_may_be_true(good: Callable[..., Path]) -> None:
    fast = SerialChain.from_urdf(good(), acceleration={"joint_a": 1.0, "joint_b": 300.0}, velocity={"joint_a": 180.0})
    assert fast.notes == (
        "joint joint_a, velocity = 180 rad/s: more than two turns a second",
        "joint joint_a, velocity = 180: beyond its file's limit.velocity = 1.5",
        "joint joint_b, acceleration = 300 rad/s^2: more than 100",
    )
    endless = SerialChain.from_urdf(good(), acceleration=np.inf, upper={"joint_a": np.inf})
    assert endless.notes == ()
    assert endless.upper[0] == np.inf
    slide = good('type="revolute"', 'type="prismatic"')  # millimetres
    long = SerialChain.from_urdf(slide, acceleration={"joint_a": 0.01, "joint_b": 0.05}, upper={"joint_a": 350.0})
    assert long.notes == (
        "joint joint_a slides by 352 m: more than 5 (in millimetres?)",
        "joint joint_a, upper = 350: beyond its file's limit.upper = 2",
        "joint joint_b, acceleration = 0.05 rad/s^2: less than 0.1 (taken for degrees?)",
    )
    with pytest.raises(ConfigurationError, match=r"locked\['joint_a'\] = 90.0: expected radians within two turns"):
        SerialChain.from_urdf(good('type="revolute"', 'type="continuous"'), acceleration=1.0, locked={"joint_a": 90.0})


def test_two_hands_ask_which(tmp_path: Path) -> None:
    file = tmp_path / "two.urdf"
    edges = random_arm(np.random.default_rng(0), 2)
    file.write_text(urdf(edges, extra='<link name="other"/>'))
    assert f"tip = None: expected the link where the arm ends, one of other, {edges[-1].child}" in refusal(file)


# ------------------------------------------------------------------------------------------------------ hostile
def hostile(tmp_path: Path, content: bytes) -> str:
    file = tmp_path / "arm.urdf"
    file.write_bytes(content)
    return refusal(file)


def test_entities_are_not_expanded(tmp_path: Path) -> None:
    lines = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    bomb = f'<!DOCTYPE r [<!ENTITY l0 "lol">{lines}]><robot name="&l11;"/>'
    assert "declares no document type" in hostile(tmp_path, bomb.encode())
    passwords = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>'
    assert "declares no document type" in hostile(tmp_path, passwords.encode())


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "XML"), (b"\0" * 100, "XML"), (b"\xff\xfe\x00", "XML"), (b"solid teapot", "XML"),
        (b"<robot>" * 100_000, "deep"), (b"<robot>" + b"<a/>" * 200_000, "elements"),
        (b"<robot>" + b" " * 11_000_000 + b"</robot>", "file size"),
        (b"<mujoco/>", "from_mjcf reads this one"), (b"<sdf/>", "a URDF"), (b"<robot/>", "tip"),
        (b'<?xml version="1.0" encoding="utf-1000"?><robot/>', "XML"),
        (b'<robot><link name="' + b"a" * 100_000 + b'"/><link name="b"/></robot>', "tip"),
        ("<robot><link name='a\u202eb\x1b'/></robot>".encode(), "XML"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_at_once(tmp_path: Path, content: bytes, expected: str) -> None:
    assert expected in hostile(tmp_path, content)


def test_a_long_cycle_is_found(tmp_path: Path) -> None:
    n = 5000
    links = "".join(f'<link name="l{i}"/>' for i in range(n))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{(i + 1) % n}"/></joint>' for i in range(n)
    )
    file = tmp_path / "cycle.urdf"
    file.write_text(f"<robot>{links}{joints}</robot>")
    assert "below itself" in refusal(file, tip="l7")
    assert "these are a loop" in refusal(file)


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_file_is_read_or_refused_with_a_typed_error(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = bytearray(urdf(random_arm(rng, 3)).encode())
    for _ in range(int(rng.integers(1, 6))):
        place = int(rng.integers(len(text)))
        kind = rng.integers(3)
        if kind == 0:
            text[place] = int(rng.integers(256))
        elif kind == 1:
            del text[place : place + int(rng.integers(1, 40))]
        else:
            text[place:place] = text[place : place + int(rng.integers(1, 40))]
    file = tmp_path / "arm.urdf"
    file.write_bytes(bytes(text))
    try:
        chain = SerialChain.from_urdf(file, acceleration=1.0)
    except (RobotFileError, ConfigurationError):
        return
    assert np.isfinite(chain.pose(np.zeros(chain.n))).all()
