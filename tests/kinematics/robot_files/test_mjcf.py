"""A chain from an MJCF moves as MuJoCo moves the model itself."""

from __future__ import annotations

import os
import re
from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import ProblemFileError, RobotFileError, SerialChain
from rehab_opt.kinematics.inertia import inertia_expression

Array = NDArray[np.float64]
LIMITS = {"velocity": 1.0, "acceleration": 10.0}


def written(values: Array) -> str:
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def random_mjcf(rng: np.random.Generator, bodies: int, *, degrees: bool) -> str:
    """Nested bodies with none to two joints each, off their bodies' origins, rotations written in four ways."""
    angle, text, ends = ("degree", "", "") if degrees else ("radian", "", "")
    scale = 180.0 if degrees else 3.0
    for i in range(bodies):
        x, y = rng.standard_normal((2, 3))
        turns = [
            f'quat="{written(rng.standard_normal(4))}"', f'euler="{written(rng.uniform(-scale, scale, 3))}"',
            f'axisangle="{written(rng.standard_normal(3))} {written(rng.uniform(-scale, scale))}"',
            f'xyaxes="{written(x)} {written(y)}"',
        ]  # fmt: skip
        text += f'<body name="body_{i}" pos="{written(rng.uniform(-0.5, 0.5, 3))}" {turns[rng.integers(4)]}>'
        text += f'<inertial pos="0.1 0 0.05" mass="{1.0 + i!r}" diaginertia="0.02 0.03 0.04"/>'
        for k in range(int(rng.integers(0, 3)) if i else 1):
            kind = str(rng.choice(["hinge", "slide"], p=[0.8, 0.2]))
            size = scale if kind == "hinge" else 1.0
            low, high = np.sort(rng.uniform(-size, size, 2)).tolist()
            limited = f'range="{low!r} {high!r}"' if rng.random() < 0.7 else ""
            place = f'pos="{written(rng.uniform(-0.2, 0.2, 3))}" axis="{written(rng.standard_normal(3))}"'
            reference = f'ref="{written(rng.uniform(-size, size) / 3)}"' if rng.random() < 0.5 else ""
            text += f'<joint name="joint_{i}_{k}" class="arm" type="{kind}" {place} {limited} {reference}/>'
        text += '<geom type="mesh" mesh="nowhere"/>'
        ends += "</body>"
    site = f'<site name="tool" pos="{written(rng.uniform(-0.2, 0.2, 3))}" quat="{written(rng.standard_normal(4))}"/>'
    return (
        f'<mujoco model="arm"><compiler angle="{angle}" meshdir="/nowhere"/><option gravity="0 0 0"/>'
        '<default><default class="arm"><joint damping="1"/><geom rgba="1 0 0 1"/></default></default>'
        '<asset><mesh name="nowhere" file="nowhere.stl"/></asset>'
        f"<worldbody><light pos='0 0 3'/>{text}{site}{ends}</worldbody>"
        "<actuator><motor joint='joint_0_0'/></actuator></mujoco>"
    )


def whole(text: str) -> mujoco.MjModel:
    """MuJoCo's own model of it, the mesh that is nowhere taken out."""
    start, end = text.index("<asset>"), text.index("</asset>")
    bare = text[:start] + text[end + 8 :]
    return mujoco.MjModel.from_xml_string(bare.replace('<geom type="mesh" mesh="nowhere"/>', ""))


@pytest.mark.parametrize("seed", range(10))
def test_random_models_move_as_in_mujoco(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = random_mjcf(rng, int(rng.integers(1, 7)), degrees=seed % 2 == 0)
    file = tmp_path / "arm.xml"
    file.write_text(text)
    chain, model = SerialChain.from_mjcf(file, tip="tool", **LIMITS), whole(text)
    assert chain.n == model.nq
    limited = model.jnt_limited.astype(bool)
    np.testing.assert_allclose(chain.lower, np.where(limited, model.jnt_range[:, 0], -np.inf))
    np.testing.assert_allclose(chain.upper, np.where(limited, model.jnt_range[:, 1], np.inf))
    data = mujoco.MjData(model)
    for q in rng.uniform(-2, 2, (20, model.nq)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, linear, angular, 0)
        pose = chain.pose(q)
        np.testing.assert_allclose(pose[:3, 3], data.site_xpos[0], atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3], data.site_xmat[0].reshape(3, 3), atol=1e-12)
        np.testing.assert_allclose(chain.jacobian(q), np.vstack([linear, angular]), atol=1e-12)
    mujoco.mj_forward(model, data)
    expected = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, expected)
    found = chain_inertia(chain, data.qpos)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def chain_inertia(chain: SerialChain, q: Array) -> Array:
    return np.array(ca.DM(inertia_expression(chain, chain.bodies, np.zeros(chain.n), ca.SX(ca.DM(q)))))


@pytest.mark.parametrize("seed", range(6))
def test_bodies_aside_are_carried(tmp_path: Path, seed: int) -> None:
    """Also such as have joints, at their reference, and bear others."""
    rng = np.random.default_rng(40 + seed)
    text = random_mjcf(rng, 4, degrees=False)
    for i in range(4):
        own = '<joint type="slide" axis="1 0 0" ref="0.3"/>' if rng.random() < 0.5 else ""
        place = f'pos="{written(rng.uniform(-0.3, 0.3, 3))}" quat="{written(rng.standard_normal(4))}"'
        mass = '<inertial pos="0 0.1 0" mass="2" diaginertia="0.02 0.03 0.04"/>'
        where = f'<body name="{rng.choice(["body", "aside"]) if i else "body"}_{rng.integers(i or 4)}" '
        at = text.index(">", text.index(where)) + 1
        text = f'{text[:at]}<body name="aside_{i}" {place}>{own}{mass}</body>{text[at:]}'
    file = tmp_path / "arm.xml"
    file.write_text(text)
    chain, model = SerialChain.from_mjcf(file, tip="tool", **LIMITS), whole(text)
    data = mujoco.MjData(model)
    at = [model.joint(name).id for name in chain.names]
    data.qpos[at] = q = rng.uniform(-2, 2, chain.n)
    mujoco.mj_forward(model, data)
    expected = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, expected)
    np.testing.assert_allclose(chain_inertia(chain, q), expected[np.ix_(at, at)], atol=1e-9)


ARM = (
    '<mujoco><worldbody><body name="a"><joint name="one" axis="0 0 1" range="-90 90"/>'
    '<body name="b" pos="0 0 1" quat="0.7071 0 0.7071 0"><joint name="two" range="-90 90"/></body></body></worldbody>'
    "</mujoco>"
)


def arm(tmp_path: Path, old: str = "", new: str = "") -> Path:
    assert old in ARM
    file = tmp_path / "arm.xml"
    file.write_text(ARM.replace(old, new, 1) if old else ARM)
    return file


def test_rounding_is_noted(tmp_path: Path) -> None:
    (note,) = SerialChain.from_mjcf(arm(tmp_path), **LIMITS).notes
    assert note.startswith("body b, quat: the length is off by 9.6e-06")


@pytest.mark.parametrize(
    ("compiler", "ranges", "noted"),
    [
        ("", ("-3.14159 3.14159", "0 2.6"), True),
        ("", ("-3.14159 3.14159", "0 90"), False),
        ('<compiler angle="radian"/>', ("-3.14159 3.14159", "0 2.6"), False),
        ("", ("", ""), False),
    ],
)
def test_ranges_in_radians_that_are_read_in_degrees_are_noted(
    tmp_path: Path, compiler: str, ranges: tuple[str, str], noted: bool
) -> None:
    """Slides are in metres, whatever angles are in."""
    file, bodies = tmp_path / "arm.xml", ""
    for i, each in enumerate(ranges):
        limit = f'limited="true" range="{each}"' if each else ""
        bodies += f'<body name="b{i}" pos="0 0 0.3"><joint name="j{i}" axis="0 1 0" {limit}/>'
    slide = '<body name="b2"><joint name="j2" type="slide" limited="true" range="0 0.3"/></body>'
    file.write_text(f"<mujoco>{compiler}<worldbody>{bodies}{slide}</body></body></worldbody></mujoco>")
    ends = {} if ranges[0] else {"lower": {"j0": -1.0, "j1": -1.0}, "upper": {"j0": 1.0, "j1": 1.0}}
    chain = SerialChain.from_mjcf(file, **LIMITS, **ends)
    said = [note for note in chain.notes if "look like radians" in note]
    assert len(said) == len(chain.notes) == noted
    if noted:
        widest = max(abs(float(each)) for pair in ranges for each in pair.split())
        degrees = 'read as degrees, as MuJoCo does without <compiler angle="radian">'
        assert said == [f"joint ranges of at most {widest:.6g} look like radians, but are {degrees}"]
        assert chain.upper[0] == pytest.approx(np.radians(float(ranges[0].split()[1])), abs=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_what_drives_may_exert_is_what_mujoco_lets_them_exert(tmp_path: Path, seed: int) -> None:
    """The largest generalised force of every joint in MuJoCo itself, at the largest commands."""
    rng = np.random.default_rng(seed)
    text, limited = random_mjcf(rng, 4, degrees=False), ""
    names = re.findall(r'<joint name="(\w+)"', text)
    for name in names:
        low, high, gear = (float(each) for each in rng.uniform(1, 9, 3))
        kind = rng.integers(4)
        if kind == 0:
            text = text.replace(f'name="{name}"', f'name="{name}" actuatorfrcrange="{-low!r} {high!r}"')
        limited += (
            f'<motor joint="{name}" class="arm" gear="{gear!r}" ctrlrange="{-low!r} {high!r}"/>',
            f'<motor joint="{name}" gear="{-gear!r}" ctrlrange="{-low!r} {high!r}"/>',
            f'<position joint="{name}" kp="1e6" forcerange="{-low!r} {high!r}"/>' * 2,
            f'<general joint="{name}" class="strong" gear="{gear!r}" ctrlrange="-1e5 1e5"/>',
        )[kind]
    text = text.replace(
        "</default></default>", '</default><default class="strong"><general forcerange="-7 5"/></default></default>'
    )
    text = text.replace("<motor joint='joint_0_0'/>", limited)
    file = tmp_path / "arm.xml"
    file.write_text(text)
    chain, model = SerialChain.from_mjcf(file, tip="tool", **LIMITS), whole(text)
    data, largest = mujoco.MjData(model), np.zeros(model.nv)
    for sign in (-1.0, 1.0):
        data.ctrl[:] = sign * 1e4
        mujoco.mj_forward(model, data)
        largest = np.maximum(largest, np.abs(data.qfrc_actuator))
    np.testing.assert_allclose(chain.effort, largest, rtol=1e-9)
    assert SerialChain.from_mjcf(file, tip="tool", **LIMITS, effort={names[0]: 3.0}).effort[0] == 3.0
    file.write_text(text.replace(limited, ""))
    given = "actuatorfrcrange" in text
    assert given or np.all(np.isinf(SerialChain.from_mjcf(file, tip="tool", **LIMITS).effort))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<worldbody>", '<compiler settotalmass="9"/><worldbody>', "compiler.settotalmass"),
        (
            "<worldbody>",
            '<compiler inertiafromgeom="true"/><worldbody>',
            "compiler.inertiafromgeom",
        ),
        (
            "<worldbody>",
            '<option gravity="0 -9.81 0" timestep="0.01"/><worldbody>',
            "option.gravity",
        ),
        ('<joint name="two"', '<joint name="two" armature="0.1"', "joint.armature"),
        ('<body name="a">', '<body name="a" gravcomp="1">', "body.gravcomp"),
        ('<body name="a">', '<body name="a"><Joint name="x"/>', "<Joint>"),
        ('<joint name="two"', '<joint name="two" Range="0 1"', "joint.Range"),
        ("<worldbody>", "<deformable/><worldbody>", "<deformable>"),
        ("<worldbody>", '<option wind="1 0 0"/><worldbody>', "option.wind"),
        ("<worldbody>", "<tendon/><worldbody>", "<tendon>"),
        (
            '<body name="a">',
            '<body name="a"><geom size="0.1" mass="2"/>',
            "the mass of the shapes of a body without <inertial>",
        ),
        ("<worldbody>", '<option gravity="0 0 -9.81"/><visual/><worldbody>', None),
    ],
)
def test_what_is_not_read_is_noted(tmp_path: Path, old: str, new: str, said: str | None) -> None:
    notes = SerialChain.from_mjcf(arm(tmp_path, old, new), **LIMITS).notes[1:]
    assert notes == (() if said is None else (f"{said} is not read (line 1)",))


@pytest.mark.parametrize("where", ["", ' angle="radian"'])
def test_global_coordinates_are_refused(tmp_path: Path, where: str) -> None:
    for file in (f'<compiler{where} coordinate="global"/>', f'<compiler{where}/><compiler coordinate="global"/>'):
        with pytest.raises(RobotFileError, match="global coordinates no longer supported"):
            SerialChain.from_mjcf(arm(tmp_path, "<worldbody>", f"{file}<worldbody>"), **LIMITS)
    local = arm(tmp_path, "<worldbody>", '<compiler coordinate="local"/><worldbody>')
    assert len(SerialChain.from_mjcf(local, **LIMITS).notes) == 1
    (tmp_path / "old.xml").write_text('<mujocoinclude><compiler coordinate="global"/></mujocoinclude>')
    with pytest.raises(RobotFileError, match="global coordinates no longer supported"):
        SerialChain.from_mjcf(arm(tmp_path, "<worldbody>", '<include file="old.xml"/><worldbody>'), **LIMITS)


def test_loops_that_are_not_closed_are_noted(tmp_path: Path) -> None:
    tie = '<equality><connect body1="a" body2="b" anchor="0 0 0"/></equality></mujoco>'
    notes = SerialChain.from_mjcf(arm(tmp_path, "</mujoco>", tie), **LIMITS).notes
    assert notes[1:] == ("line 1, <connect>: joints that it ties to one another are taken as free",)


def test_an_included_file_takes_the_place_of_its_line(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text(
        '<mujocoinclude><body name="c" pos="1 0 0"><joint name="three"/></body></mujocoinclude>'
    )
    file = arm(tmp_path, "</body></body>", '<include file="hand.xml"/></body></body>')
    chain = SerialChain.from_mjcf(file, **LIMITS)
    assert chain.names == ("one", "two", "three")
    np.testing.assert_allclose(chain.pose(np.zeros(3))[:3, 3], [0, 0, 0], atol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "options", "expected"),
    [
        ('axis="0 0 1"', 'axis="0 0 0"', {}, "file = "),
        ('pos="0 0 1"', 'pos="0 0 1000"', {}, "body b, pos"),
        ('<joint name="two" range="-90 90"', '<joint name="two" type="ball"', {}, "joint two, type = 'ball'"),
        ("", "", {"base": "b", "tip": "a"}, "tip = 'a': expected a body or site below base = 'b'"),
        ('range="-90 90"', 'range="-9000 90"', {}, "joint one, range[0]"),
        ("<worldbody>", '<worldbody><include file="pipe"/>', {}, "a pipe"),
        ("<worldbody>", '<worldbody><include file="arm.xml"/>', {}, "at most 20 files"),
        ("<worldbody>", '<worldbody><include file="/etc/passwd"/>', {}, "XML"),
        ("</mujoco>", '<equality><joint joint1="two" joint2="one"/></equality></mujoco>', {}, "joint two, mimic.joint"),
        ("<mujoco>", "<robot>", {}, "XML"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(
    tmp_path: Path, old: str, new: str, options: dict[str, str], expected: str
) -> None:
    os.mkfifo(tmp_path / "pipe")
    file = arm(tmp_path, old, new)
    with pytest.raises(ProblemFileError) as caught:
        SerialChain.from_mjcf(file, **LIMITS, **options)
    assert expected in str(caught.value)
    assert str(file) in str(caught.value)
    assert len(str(caught.value)) <= 400
