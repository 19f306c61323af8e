"""MJCF: the steps from a base body to a tip, as MuJoCo compiles them.

MuJoCo interprets defaults, frames, rotations and optional limits. We pass only the kinematic elements to MuJoCo, so
that it opens no mesh, no texture and no other file.
"""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.denavit_hartenberg import TWO_TURNS
from rehab_opt.kinematics.robot_file.steps import (
    BARELY,
    Inertial,
    Joint,
    Step,
    moved,
    turned_about,
    turned_by_quaternion,
)
from rehab_opt.kinematics.robot_file.xml_tree import FARTHEST, Element, Source, xml_root
from rehab_opt.text_file import number_in, shown

if TYPE_CHECKING:
    from collections.abc import Container, Iterator, Mapping

__all__ = ["mjcf_steps"]

Array = NDArray[np.float64]

_TURNS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_RANGES = ("actuatorfrcrange", "forcerange", "ctrlrange", "gear")
_AMOUNTS = ("axis", "range", "ref", "mass", "diaginertia", "fullinertia", *_RANGES, *_TURNS)
_DRIVE = ("name", "class", "joint", "jointinparent", "gear", "forcelimited", "forcerange", "ctrllimited", "ctrlrange")
DRIVES = ("motor", "position", "velocity", "general")
KINEMATICS: Mapping[str, tuple[str, ...]] = {
    "compiler": ("angle", "eulerseq", "autolimits", "coordinate"),
    "default": ("class",),
    "worldbody": (),
    "body": ("name", "childclass", "pos", "mocap", *_TURNS),
    "frame": ("name", "childclass", "pos", *_TURNS),
    "replicate": ("count", "offset", "euler", "sep"),
    "joint": ("name", "class", "type", "pos", "axis", "limited", "range", "ref", "joint1", "joint2", "active",
              "actuatorfrclimited", "actuatorfrcrange"),
    "freejoint": ("name",),
    "inertial": ("pos", "mass", "diaginertia", "fullinertia", *_TURNS),
    "site": ("name", "class", "pos", "fromto", *_TURNS),
    "equality": (),
    "actuator": (),
    **dict.fromkeys(DRIVES, _DRIVE),
}  # fmt: skip
"""Elements and attributes that define bodies, their joints and their drives."""
BESIDE = {
    "compiler": "strippath meshdir texturedir assetdir discardvisual usethread fusestatic fitaabb convexhull "
    "saveinertial inertiagrouprange alignfree boundmass boundinertia exactmeshinertia",
    "body": "user sleep",
    "joint": "group user margin polycoef solref solimp solreflimit solimplimit solreffriction solimpfriction",
    "freejoint": "group align",
    "site": "group material size rgba type user",
}
"""Other attributes of these elements, ignored without a note."""
APART = (
    "geom camera light asset visual statistic size sensor keyframe custom contact extension mesh material pair connect "
    "weld flex include"
)
"""Other elements: ignored without a note, or reported in another note."""
UNIT: Mapping[str, Mapping[str, int]] = {
    "joint": {"axis": 3},
    **{tag: {"quat": 4, "axisangle": 3} for tag in ("body", "frame", "site", "inertial")},
}
"""Attributes with a unit vector, and its number of components."""
LOOPS = ("connect", "weld", "tendon")
"""Elements of <equality> that couple bodies or several joints."""
EARTH = "0 0 -9.81"
"""[m/s^2] Default gravity of MuJoCo and of the plant."""
MAX_INCLUDES = 20
MUCH_TOO_LIGHT = 1e-9
"""[kg, kg m^2] Placeholder mass and inertia that MuJoCo requires; unused."""


def mjcf_steps(
    source: Source, *, base: str | None, tip: str | None, bodies: bool = False
) -> tuple[list[Step], list[str]]:
    """Steps from body `base` (default the world) to body or site `tip` (default the only leaf), and notes.

    Only the masses that the file states are used, not those that MuJoCo would compute from shapes and meshes.

    Raises
    ------
    ProblemFileError : the file cannot be read.
    RobotFileError : MuJoCo reports an error, or the tip is not below the base.
    ConfigurationError : MuJoCo is not installed, or `bodies` is set (geometry is not read).
    """
    if bodies:
        raise ConfigurationError("capsules", "collision", "CapsuleOnLinks: of an MJCF no geometry is read")
    try:
        import mujoco  # noqa: PLC0415  (an extra)
    except ImportError as problem:
        expected = "MuJoCo beside it, which reads MJCF: pip install 'rehab_opt[mjcf]'"
        raise ConfigurationError("file", source.name, expected) from problem
    root = xml_root(source)
    if root.tag != "mujoco":
        expected = "an MJCF, <mujoco>" + ("; from_urdf reads this one" if root.tag == "robot" else "")
        raise source.refuse(f"line {root.line}", f"<{root.tag}>", expected)
    _include(root, source, [])
    notes = list(_rounded(root))
    ties = [tie for equality in root.each("equality") for tie in equality.children if tie.tag in LOOPS]
    notes += [f"line {each.line}, <{each.tag}>: joints that it ties to one another are taken as free" for each in ties]
    notes += _unread(root)
    written = "<mujoco>" + "".join(_kinematics(root, source)) + "</mujoco>"
    try:
        model = mujoco.MjModel.from_xml_string(written)
    except (ValueError, mujoco.FatalError) as problem:
        why = shown(" ".join(str(problem).split()), 150)
        raise source.refuse("file", "refused by MuJoCo", f"a model that it compiles ({why})") from problem
    hinges = model.jnt_limited & (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    widest = np.degrees(np.abs(model.jnt_range[hinges > 0]).max(initial=0.0))
    if 0.0 < widest <= TWO_TURNS and "radian" not in (each.attributes.get("angle") for each in root.each("compiler")):
        degrees = 'read as degrees, as MuJoCo does without <compiler angle="radian">'
        notes.append(f"joint ranges of at most {widest:.6g} look like radians, but are {degrees}")
    return _steps(mujoco, model, source, base, tip, notes=notes), notes


def _include(root: Element, source: Source, read: list[Element]) -> None:
    """Replace each <include> by the content of the file that it names, as MuJoCo does."""
    for element in list(root.all()):
        if element.tag == "attach":
            expected = "one model; let MuJoCo attach the others, and save it"
            raise source.refuse(f"line {element.line}", "<attach>", expected)
        children: list[Element] = []
        for child in element.children:
            if child.tag != "include":
                children.append(child)
                continue
            read.append(child)
            name = child.text("file", source, f"line {child.line}")
            if len(read) > MAX_INCLUDES:
                raise source.refuse(f"line {child.line}, include.file", name, f"at most {MAX_INCLUDES} files")
            path = source.path.parent / name
            other = Source(path, f"{source.name}: {name}")
            inside = xml_root(other)
            _include(inside, Source(path, other.name), read)
            children += inside.children
        element.children = children


def _rounded(root: Element) -> Iterator[str]:
    """Note on the rotation or axis whose length differs most from one by rounding; MuJoCo normalises them."""
    worst, where = 0.0, ""
    for element in root.all():
        for key, count in UNIT.get(element.tag, {}).items():
            try:
                length = math.hypot(*map(float, element.attributes.get(key, "").split()[:count]))
            except ValueError:  # MuJoCo reports the error
                continue
            off = abs(length - 1.0)
            if worst < off <= 1e-3:
                worst, where = off, f"{element.tag} {element.attributes.get('name', f'in line {element.line}')}, {key}"
    if worst > BARELY:
        yield f"{where}: the length is off by {worst:.2g}, as rounded numbers are, the largest such one; 1 is used"


def _unread(root: Element) -> Iterator[str]:
    """Notes on ignored elements and attributes that concern bodies, joints or masses."""
    waiting, found = [root], dict[str, list[int]]()
    while waiting:
        for child in waiting.pop().children:
            if child.tag in KINEMATICS:
                waiting.append(child)
                known = {*KINEMATICS[child.tag], *BESIDE.get(child.tag, "").split()}
                unread = [f"{child.tag}.{key}" for key in child.attributes if not (key in known or child.tag in DRIVES)]
                inside = {each.tag for each in child.children}
                if child.tag == "body" and "geom" in inside and "inertial" not in inside:
                    unread.append("the mass of the shapes of a body without <inertial>")
            elif child.tag == "option":
                gravity = child.attributes.get("gravity", EARTH).split()
                unread = [f"option.{key}" for key in ("wind", "density", "viscosity") if key in child.attributes]
                unread += ["option.gravity"] if gravity != EARTH.split() else []
            else:
                unread = [] if child.tag in APART.split() else [f"<{child.tag}>"]
            for each in unread:
                found.setdefault(each, []).append(child.line)
    for what, lines in found.items():
        more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
        yield f"{what} is not read (line {lines[0]}{more})"


def _kinematics(element: Element, source: Source) -> Iterator[str]:
    """XML text of those parts of an element that determine kinematics; NaN and infinity raise an error."""
    for child in element.children:
        drives_another = element.tag == "actuator" and not {"joint", "jointinparent"} & set(child.attributes)
        if child.tag not in KINEMATICS or drives_another:
            continue
        owner = f"{child.tag} {child.attributes.get('name', f'in line {child.line}')}"
        for key, most in (("pos", FARTHEST), *((key, math.inf) for key in _AMOUNTS)):
            values = child.attributes.get(key, "").split()
            if not all(abs(number_in(value)) <= min(most, 1e300) for value in values):
                limit = "" if math.isinf(most) else f" within {most:g} m"
                raise source.refuse(f"{owner}, {key}", child.attributes[key], f"finite numbers{limit}")
        kept = {key: value for key, value in child.attributes.items() if key in KINEMATICS[child.tag]}
        if child.tag == "compiler":
            kept |= {"boundmass": str(MUCH_TOO_LIGHT), "boundinertia": str(MUCH_TOO_LIGHT)}
        written = "".join(f' {key}="{html.escape(value)}"' for key, value in kept.items())
        yield f"<{child.tag}{written}>"
        yield from _kinematics(child, source)
        yield f"</{child.tag}>"
    if element.tag == "mujoco":
        yield f'<compiler boundmass="{MUCH_TOO_LIGHT}" boundinertia="{MUCH_TOO_LIGHT}"/>'


def _steps(
    mujoco: Any, model: Any, source: Source, base: str | None, tip: str | None, *, notes: list[str]
) -> list[Step]:
    site = -1
    if tip is None:
        bodies = set(range(model.nbody)) - set(model.body_parentid.tolist())
        if len(bodies) != 1:
            names = ", ".join(sorted(model.body(i).name for i in bodies)[:8])
            raise source.refuse("tip", None, f"the body or site where the arm ends, such as one of {names}")
        last = bodies.pop()
    else:
        last = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, tip)
        if last < 0:
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tip)
            if site < 0:
                raise source.refuse("tip", tip, "a body or a site of this file")
            last = int(model.site_bodyid[site])
    first = 0 if base is None else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, base)
    if first < 0:
        raise source.refuse("base", base, "a body of this file")
    way = [last]
    while way[-1] not in (first, 0):
        way.append(int(model.body_parentid[way[-1]]))
    if way[-1] != first:
        raise source.refuse("tip", tip, f"a body or site below base = {base!r}")
    coupled = _coupled(mujoco, model)
    steps = [Step(np.eye(4), None, model.body(first).name, None)]
    for body in reversed(way[:-1]):
        steps += _body_steps(mujoco, model, body, coupled, source)
        steps += _carried(model, body, way, notes)
    if site >= 0:
        steps.append(Step(_pose(model.site_pos[site], model.site_quat[site]), None, model.site(site).name))
    return steps


def _coupled(mujoco: Any, model: Any) -> dict[int, str]:
    """By number of each coupled joint: name of the joint that it follows, or "equality" if there is none."""
    found = {}
    for i in range(model.neq):
        if mujoco.mjtEq(int(model.eq_type[i])) == mujoco.mjtEq.mjEQ_JOINT and model.eq_active0[i]:
            one, other = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
            found[one] = model.joint(other).name if other >= 0 else "equality"
    return found


def _body_steps(mujoco: Any, model: Any, body: int, coupled: dict[int, str], source: Source) -> Iterator[Step]:
    """Steps of one body: one for each of its joints, then one for its frame."""
    here = _pose(model.body_pos[body], model.body_quat[body])
    name = model.body(body).name
    start = int(model.body_jntadr[body])
    for j in range(start, start + int(model.body_jntnum[body])):
        kind, joint = mujoco.mjtJoint(int(model.jnt_type[j])), model.joint(j).name or f"{name}_joint_{j - start + 1}"
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            which = "free" if kind == mujoco.mjtJoint.mjJNT_FREE else "ball"
            raise source.refuse(f"joint {joint}, type", which, "hinge or slide; let the chain begin at another body")
        slides = kind == mujoco.mjtJoint.mjJNT_SLIDE
        axis, point = np.array(model.jnt_axis[j]), moved(*model.jnt_pos[j])
        lower, upper = model.jnt_range[j].tolist() if model.jnt_limited[j] else (-math.inf, math.inf)
        effort = _effort(mujoco, model, j)
        yield Step(here @ point, Joint(joint, slides, axis, lower, upper, math.nan, coupled.get(j, ""), effort))
        reference = float(model.qpos0[model.jnt_qposadr[j]])
        here = np.eye(4)
        if slides:
            here[:3, 3] = -reference * axis
        else:
            here[:3, :3] = turned_about(axis, -reference)
        here = here @ moved(*-model.jnt_pos[j])
    yield Step(here, None, name, _inertial(model, body))


def _effort(mujoco: Any, model: Any, joint: int) -> float:
    """Largest effort [N m, N] of a joint's drives, infinite if the file has none."""
    limits = list[float]()
    kinds = {int(kind) for kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)}
    if model.jnt_actfrclimited[joint]:
        limits.append(float(np.abs(model.jnt_actfrcrange[joint]).max()))
    drives = [
        i for i in range(model.nu) if model.actuator_trnid[i, 0] == joint and int(model.actuator_trntype[i]) in kinds
    ]
    if drives:
        limits.append(sum(abs(float(model.actuator_gear[i, 0])) * _force(mujoco, model, i) for i in drives))
    return min((each for each in limits if each > 0.0), default=math.inf)


def _force(mujoco: Any, model: Any, drive: int) -> float:
    if model.actuator_forcelimited[drive]:
        return float(np.abs(model.actuator_forcerange[drive]).max())
    motor = int(model.actuator_biastype[drive]) == int(mujoco.mjtBias.mjBIAS_NONE)
    if motor and model.actuator_ctrllimited[drive]:  # the force of a motor is its command
        return float(np.abs(model.actuator_ctrlrange[drive]).max() * abs(model.actuator_gainprm[drive, 0]))
    return math.inf


def _carried(model: Any, link: int, way: Container[int], notes: list[str]) -> Iterator[Step]:
    """Steps to the bodies that branch off from `link`, with their joints at the initial values."""
    poses = {link: np.eye(4)}
    for body in range(link + 1, int(model.nbody)):  # a body comes after the one that carries it
        parent = int(model.body_parentid[body])
        if parent in poses and body not in way:
            name = model.body(body).name
            poses[body] = poses[parent] @ _pose(model.body_pos[body], model.body_quat[body])
            start = int(model.body_jntadr[body])
            for j in range(start, start + int(model.body_jntnum[body])):
                joint = model.joint(j).name or f"{name}_joint_{j - start + 1}"
                notes.append(f"joint {joint} is not between base and tip: body {name} is taken where it is at first")
            yield Step(poses[body], None, name, _inertial(model, body), aside=True)


def _inertial(model: Any, body: int) -> Inertial | None:
    mass = float(model.body_mass[body])
    if not mass > 10 * MUCH_TOO_LIGHT:
        return None
    turn = turned_by_quaternion(model.body_iquat[body])
    matrix = turn @ np.diag(model.body_inertia[body]) @ turn.T
    return Inertial(mass, np.array(model.body_ipos[body]), matrix)


def _pose(place: Array, quaternion: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = turned_by_quaternion(quaternion)
    pose[:3, 3] = place
    return pose
