"""What is wrong with a robot file is said in two lines: file, joint, key, value, what was expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import CapsuleOnLink, ConfigurationError, ProblemFileError, SerialChain
from rehab_opt.errors import RobotFileError
from tests.golden import assert_kept
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


HEAVY = '<link name="middle"><inertial><mass value="2"/><inertia ixx="{}" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'  # noqa: E501  # fmt: skip
EDITS = (
    ('xyz="0 1 0"', 'xyz="0 0 0"'), ('xyz="0 1 0"', 'xyz="1 1 0"'), ('xyz="0 1 0"', ""),
    ('xyz="0 0 0.3"', 'xyz="0 0 inf"'), ('xyz="0 0 0.3"', 'xyz="0 0 300"'), ('rpy="0 1.5708 0"', 'rpy="0 90 0"'),
    ('lower="-2"', 'lower="-114"'), ('upper="2"', 'upper="-3"'), ('velocity="1.5"', 'velocity="0"'),
    ('lower="-2" upper="2"', ""), ('type="revolute"', 'type="Revolute"'), ('name="joint_b"', 'name="joint_a"'),
    ('link name="hand"', 'link name="middle"'), ('<link name="middle"/>', ""), ("<axis", "<origin/><axis"),
    ('<parent link="base"', '<parent link="middle"'), ('<parent link="base"/>', '<parent link="hand"/>'),
    ('<child link="hand"/>', '<child link="middle"/>'), ('<link name="base"/>', '<link name="base"/><xacro:a/>'),
    ('lower="-2"', 'lower="${-2}"'), ('rpy="0 1.5708 0"', 'quat_xyzw="0 0 0 1"'), ("<axis", "<Axis"),
    ('<robot name="good">', '<robot version="1.1" name="good">'), ('rpy="0 1.5708 0"', 'RPY="0 1.5708 0"'),
    ('velocity="1.5"', 'velocity="1.5" acceleration="3"'), ('type="revolute"><parent', 'type="fixed"><Origin/><parent'),
    ('"revolute"', '"continuous"'), ('"revolute"', '"prismatic"'),
    *(('<link name="middle"/>', HEAVY.format(xx)) for xx in (0.02, 0.021, -0.01, 0.0)),
)  # fmt: skip
"""Of the good file: what becomes of something in it."""
OPTIONS: tuple[dict[str, object], ...] = (
    {"tip": "nowhere"}, {"base": "hand", "tip": "middle"}, {"base": "hand"}, {"locked": None}, {"tip": "base"},
    {"capsules": "collision"}, {"capsules": [CapsuleOnLink("hand", (0, 0, 0), (0, 0, 1), -0.1)]},
    {"lower": {"joint_a": 5.0}}, {"lower": 1.0, "upper": 0.5}, {"locked": {"joint_c": 1.0}},
    {"locked": {"joint_a": np.nan}}, {"locked": {"joint_a": 2.5}}, {"acceleration": [1.0, 2.0, 3.0]},
    {"acceleration": "fast"}, {"velocity": -1.0}, {"acceleration": np.inf, "upper": {"joint_a": np.inf}},
    {"acceleration": {"joint_a": 1.0, "joint_b": 300.0}, "velocity": {"joint_a": 30.0}},
    {"acceleration": 1.0, "velocity": {"joint_a": 180.0}}, {"acceleration": 1.0, "velocity": {"joint_a": 8.0}},
    {"acceleration": {"joint_a": 0.01, "joint_b": 0.05}, "upper": {"joint_a": 350.0}}, {"locked": {"joint_a": 90.0}},
)  # fmt: skip
TURNS = 'quat_xyzw="0 0.6 0 0.9"', 'quat_xyzw="0 0 1"', 'rpy="0 0 0" quat_xyzw="0 0 0 1"', 'quat_xyzw="0 0.6 0 0.8"'


def test_what_is_said_of_a_bad_value_or_argument_is_what_was_kept(good: Callable[..., Path]) -> None:
    """File, joint, key, value, what was expected; or what is noted of what can be used."""
    new = [good(*edit).read_text() for edit in EDITS]
    later = good('<robot name="good">', '<robot version="1.1" name="good">').read_text()
    cases = [(text, {}) for text in (*new, *(later.replace('rpy="0 1.5708 0"', turn, 1) for turn in TURNS))]
    cases += [(text, each) for text in (good().read_text(), new[-6], new[-5]) for each in OPTIONS]
    said = []
    for text, options in cases:
        file = good()
        file.write_text(text)
        try:
            chain = SerialChain.from_urdf(file, **{"acceleration": 1.0, **options})  # type: ignore[arg-type]
            said.append("; ".join(chain.notes))
        except (ProblemFileError, ConfigurationError) as refused:
            said.append(str(refused).replace(str(file.parent), ""))
    assert max(map(len, said)) <= 2 * 200
    assert not any("\n" in each for each in said)
    assert_kept("kinematics_refusals", said)


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
