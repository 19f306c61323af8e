"""Convert steps of a robot file to `SerialChain` arguments: axes aligned with z, fixed steps merged."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.body import Body, of_a_body
from rehab_opt.kinematics.denavit_hartenberg import FASTEST, SIX_TURNS, TWO_TURNS
from rehab_opt.kinematics.link import Link
from rehab_opt.kinematics.link_capsules import CapsuleOnLink, LinkCapsule
from rehab_opt.kinematics.real_array import real_array
from rehab_opt.kinematics.rigid import inverse_pose
from rehab_opt.kinematics.robot_file.mjcf import mjcf_steps
from rehab_opt.kinematics.robot_file.steps import Joint, Step, moved, turned_about
from rehab_opt.kinematics.robot_file.urdf import urdf_steps
from rehab_opt.kinematics.robot_file.xml_tree import Source

__all__ = ["MJCF", "URDF", "Given", "Metres", "Radians", "chain_arguments"]

Array = NDArray[np.float64]
PerJoint = ArrayLike | Mapping[str, float]

HARD, SOFT = 100.0, 0.1
"""[rad/s^2] Largest and smallest usual acceleration limits of a revolute joint; beyond them, degrees and radians may be
mixed up."""
FAST, LONG = 5.0, 5.0
"""[m/s, m] Largest usual speed and travel of a prismatic joint; larger values may be in millimetres."""
COLLISION = "collision"
"""Value of `capsules` that selects the collision geometry of the file."""


class Metres(float):
    """A length, valid only for a prismatic joint."""


class Radians(float):
    """An angle, valid only for a revolute joint."""


class Given(NamedTuple):
    """A caller's arguments besides the file: see `SerialChain.from_urdf`."""

    acceleration: PerJoint
    velocity: PerJoint | None
    lower: PerJoint | None
    upper: PerJoint | None
    locked: Mapping[str, float]
    capsules: Sequence[CapsuleOnLink] | Literal["collision"]
    effort: PerJoint | None


class _Fixed(NamedTuple):
    """A link, its pose in the axes of the last moving joint before it, and the step that has its mass."""

    joint: int
    """Number of joints that move the link."""
    pose: Array
    step: Step


class Format(NamedTuple):
    """Reader of one file format."""

    steps: Callable[..., tuple[list[Step], list[str]]]
    """Function (source, base, tip) -> (steps, notes)."""
    keys: tuple[str, str, str]
    """The format's names of a joint's lower limit, upper limit and speed limit."""


URDF = Format(urdf_steps, ("limit.lower", "limit.upper", "limit.velocity"))
MJCF = Format(mjcf_steps, ("range[0]", "range[1]", "speed"))


def chain_arguments(form: Format, file: str | Path, base: str | None, tip: str | None, given: Given) -> dict[str, Any]:
    """Arguments of the `SerialChain` between two links of a file.

    Raises
    ------
    RobotFileError : the file or its limits are invalid, a joint is coupled, or none moves. ProblemFileError : the file
        cannot be read. ConfigurationError : a caller's argument is invalid.
    """
    if not isinstance(file, str | Path) or "\0" in str(file) or not str(file):
        raise ConfigurationError("file", file, "the path of a robot file: str or Path")
    for name, link in (("base", base), ("tip", tip)):
        if not isinstance(link, str | None):
            raise ConfigurationError(name, link, "the name of a link, or None")
    if not isinstance(given.locked, Mapping):
        raise ConfigurationError("locked", given.locked, "joint values by joint name")
    if given.capsules != COLLISION and not isinstance(given.capsules, list | tuple):
        raise ConfigurationError("capsules", given.capsules, "a list or tuple of CapsuleOnLink, or 'collision'")
    source, keys = Source(Path(file), str(file)), form.keys
    steps, notes = form.steps(source, base=base, tip=tip, bodies=given.capsules == COLLISION)
    if not steps and base is not None and tip is None:
        raise source.refuse("base", base, "a link that bears others, from which an arm begins")
    if not steps:
        raise source.refuse("tip", tip, "a link that joints move against the base")
    capsules = given.capsules
    if capsules == COLLISION:
        capsules = [each for step in steps for each in step.bodies]
        if not capsules:
            expected = f"<collision> in links between base and tip: {source.name} has none"
            raise ConfigurationError("capsules", COLLISION, expected)
    joints, before, frames = _joints_and_frames(steps, given.locked, source, notes)
    n, names = len(joints), tuple(joint.name for joint in joints)
    rows = tuple(Link(before[i + 1], joints[i].prismatic) for i in range(n))
    # Link frames are known in the axes of the joint before them; a row's frame lies at the next joint's axes.
    back = [inverse_pose(before[0]), *(inverse_pose(row.after) for row in rows)]
    places = {each.step.link: (each.joint, back[each.joint] @ each.pose) for each in frames}
    lower, upper, velocity = _limits(joints, given, source, keys, notes)
    effort = _by_joint("effort", given.effort, names, np.array([joint.effort for joint in joints]))
    notes += [
        f"link {each.step.link}, inertia: no body has it; robots with mass refuse it"
        for each in frames
        if each.step.inertial is not None and not of_a_body(each.step.inertial.inertia)
    ]
    return {
        "rows": rows,
        "base": before[0],
        "names": names,
        "lower": lower,
        "upper": upper,
        "velocity": velocity,
        "acceleration": _accelerations(given.acceleration, joints, notes),
        "capsules": tuple(_capsule(i, each, places) for i, each in enumerate(capsules)),
        "effort": effort,
        "bodies": tuple(_body(each, places) for each in frames if each.step.inertial is not None),
        "notes": tuple(notes),
    }


def _joints_and_frames(
    steps: Sequence[Step], locked: Mapping[str, float], source: Source, notes: list[str]
) -> tuple[list[Joint], list[Array], list[_Fixed]]:
    """Three results: the n moving joints, n + 1 poses, and the links that they move or that are fixed to the base.

    Pose i is that of joint i's axes in the axes of the joint before; the last pose is that of the tip.
    """
    unknown = sorted(set(locked) - {step.joint.name for step in steps if step.joint is not None})
    if unknown:
        raise ConfigurationError("locked", unknown[0], "a joint between base and tip")
    joints: list[Joint] = []
    before: list[Array] = []
    frames: list[_Fixed] = []
    here = np.eye(4)  # pose of the next frame in the axes of the last moving joint
    for step in steps:
        if step.aside:
            if joints:  # a part of the base does not move
                frames.append(_Fixed(len(joints), here @ step.origin, step))
            continue
        here = here @ step.origin
        joint = step.joint
        if joint is not None and joint.name in locked:
            value = locked[joint.name]
            here = here @ _at(joint, value)
            notes.append(f"joint {joint.name} is locked at {value:.6g} {'m' if joint.prismatic else 'rad'}")
        elif joint is not None:
            if joint.coupled_to:
                expected = f"a joint that moves by itself; lock it: locked={{{joint.name!r}: value}}"
                raise source.refuse(f"joint {joint.name}, mimic.joint", joint.coupled_to, expected)
            axes = _axes(joint.axis)
            before.append(here @ axes)
            here = axes.T
            joints.append(joint)
        if step.link:
            frames.append(_Fixed(len(joints), here, step))
    if not joints:
        raise source.refuse("tip", steps[-1].link, "a link that joints move against the base")
    return joints, [*before, here], frames


def _axes(axis: Array) -> Array:
    """(4, 4) rotation with z along a unit axis (3,); exact for the axes x, y and z."""
    across = np.zeros(3)
    across[np.argmin(np.abs(axis))] = 1.0
    y = np.cross(axis, across)
    y /= np.linalg.norm(y)
    turn = np.eye(4)
    turn[:3, :3] = np.column_stack([np.cross(y, axis), y, axis])
    return turn + 0.0  # no negative zeros


def _at(joint: Joint, value: object) -> Array:
    """(4, 4) motion of a joint from zero to `value`."""
    try:
        amount = float(real_array(value))
    except (TypeError, ValueError, OverflowError):
        amount = math.nan
    unit = "m" if joint.prismatic else "rad"
    if isinstance(value, Radians if joint.prismatic else Metres):
        expected = "metres: the joint slides" if joint.prismatic else "an angle: the joint turns"
        raise ConfigurationError(f"locked[{joint.name!r}]", float(value), expected)
    if not abs(amount) < math.inf:
        raise ConfigurationError(f"locked[{joint.name!r}]", value, "a finite joint value")
    if not joint.prismatic and abs(amount) > TWO_TURNS:
        raise ConfigurationError(f"locked[{joint.name!r}]", value, "radians within two turns")
    if amount < joint.lower or amount > joint.upper:  # false if the file has no limit (NaN)
        expected = f"a value within the joint's {joint.lower:.6g} to {joint.upper:.6g} {unit}"
        raise ConfigurationError(f"locked[{joint.name!r}]", value, expected)
    if joint.prismatic:
        return moved(*(amount * joint.axis))
    pose = np.eye(4)
    pose[:3, :3] = turned_about(joint.axis, amount)
    return pose


def _limits(
    joints: Sequence[Joint], given: Given, source: Source, keys: tuple[str, str, str], notes: list[str]
) -> tuple[Array, Array, Array]:
    """Lower, upper and speed limits (n,): the caller's if given, else the file's."""
    names, arguments = tuple(joint.name for joint in joints), ("lower", "upper", "velocity")
    none = np.full(len(joints), math.nan)
    own = np.array([_by_joint(name, getattr(given, name), names, none) for name in arguments])
    found = np.array([[joint.lower, joint.upper, joint.velocity] for joint in joints]).T
    limits = np.where(np.isnan(own), found, own)
    for i, joint in enumerate(joints):
        low, high, speed = limits[:, i].tolist()
        of_file = np.isnan(own[:, i])
        unit = "m" if joint.prismatic else "rad"

        def refused(k: int, expected: str, *, i: int = i, of_file: Array = of_file) -> Exception:
            value = None if math.isnan(limits[k, i]) else float(limits[k, i])
            if of_file[k]:
                return source.refuse(f"joint {names[i]}, {keys[k]}", value, expected)
            return ConfigurationError(f"{arguments[k]}[{names[i]!r}]", value, expected)

        for k, value in enumerate((low, high, speed)):
            if math.isnan(value) or (k == 2 and not 0.0 < value < math.inf):
                what = f"a speed above 0 {unit}/s" if k == 2 else f"a limit [{unit}]"
                missing = f"; the file has none: give {arguments[k]}={{{joint.name!r}: value}}" if of_file[k] else ""
                raise refused(k, what + missing)
            if k < 2 and not joint.prismatic and TWO_TURNS < abs(value) < math.inf:
                none_given = f"{arguments[k]}={{{joint.name!r}: {math.copysign(math.inf, k - 0.5)}}}"
                raise refused(k, f"radians within two turns, as a joint that has ends; if it has none: {none_given}")
        if speed > (highest := FASTEST if joint.prismatic else SIX_TURNS):
            raise refused(2, f"at most {highest:.3g}: is it in {unit}/s?")
        if not low <= high or low == math.inf or high == -math.inf:
            k = 0 if of_file[1] else 1  # the limit that the caller gave
            other = f"{keys[1 - k]} of {source.name}" if of_file[1 - k] else arguments[1 - k]
            expected = f"no {('more', 'less')[k]} than {other}, {_said((high, low)[k], joint)}"
            raise refused(k, expected if not of_file[k] else f"no more than {keys[1]} = {high:.6g}")
        if low == high and np.all(of_file[:2]):
            notes.append(f"joint {joint.name}, {keys[0]} = {keys[1]} = {low:.6g}: it does not move")
        if speed > (FAST if joint.prismatic else TWO_TURNS):
            key = keys[2] if of_file[2] else "velocity"
            most = f"{FAST:g} m/s" if joint.prismatic else "two turns a second (in degrees?)"
            notes.append(f"joint {joint.name}, {key} = {speed:.6g} {unit}/s: more than {most}")
        if joint.prismatic and max(abs(low), abs(high)) < math.inf and high - low > LONG:
            notes.append(f"joint {joint.name} slides by {high - low:.6g} m: more than {LONG:g} (in millimetres?)")
        for k, further in enumerate((low < found[0, i], high > found[1, i], speed > found[2, i])):
            value, theirs = float(limits[k, i]), float(found[k, i])
            if further and not of_file[k] and math.isfinite(value):  # false if the file has no limit (NaN)
                notes.append(
                    f"joint {joint.name}, {arguments[k]} = {value:.6g}: beyond its file's {keys[k]} = {theirs:.6g}"
                )
    return limits[0], limits[1], limits[2]


def _said(value: float, joint: Joint) -> str:
    """Joint position as text, in degrees for a revolute joint."""
    return f"{value:.6g} m" if joint.prismatic else f"{value:.6g} rad ({math.degrees(value):.5g} deg)"


def _accelerations(given: PerJoint, joints: Sequence[Joint], notes: list[str]) -> Array:
    names = tuple(joint.name for joint in joints)
    values = _by_joint("acceleration", given, names, np.full(len(names), math.nan))
    missing = [name for name, value in zip(names, values, strict=True) if math.isnan(value)]
    if missing:
        raise ConfigurationError("acceleration", given, f"a limit of {missing[0]} too: robot files have none")
    hard = [i for i, joint in enumerate(joints) if HARD < values[i] < math.inf and not joint.prismatic]
    notes += [f"joint {names[i]}, acceleration = {values[i]:.6g} rad/s^2: more than {HARD:g}" for i in hard]
    soft = [i for i, joint in enumerate(joints) if values[i] < SOFT and not joint.prismatic]
    notes += [
        f"joint {names[i]}, acceleration = {values[i]:.6g} rad/s^2: less than {SOFT:g} (taken for degrees?)"
        for i in soft
    ]
    return values


def _by_joint(argument: str, value: PerJoint | None, names: tuple[str, ...], default: Array) -> Array:
    """(n,) values from one number, n numbers, or numbers by joint name; missing names get `default`."""
    if value is None:
        return default
    expected = f"one number, {len(names)} numbers, or numbers by joint name, none of them NaN"
    named = value if isinstance(value, Mapping) else {}
    unknown = [name for name in named if name not in names]
    if unknown:
        raise ConfigurationError(argument, unknown[0], f"joint names among {', '.join(names)}")
    try:
        said = np.array(real_array(list(named.values()) if isinstance(value, Mapping) else value))
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, expected) from problem
    if np.isnan(said).any() or said.shape not in ((len(named),) if isinstance(value, Mapping) else (), (len(names),)):
        raise ConfigurationError(argument, value, expected)
    if not isinstance(value, Mapping):
        return np.broadcast_to(said, (len(names),)).copy()
    values = default.copy()
    values[[names.index(name) for name in named]] = said
    return values


def _capsule(i: int, given: object, places: Mapping[str, tuple[int, Array]]) -> LinkCapsule:
    if not isinstance(given, CapsuleOnLink):
        raise ConfigurationError(f"capsules[{i}]", given, "a CapsuleOnLink(link, start (3,), end (3,), radius)")
    if given.link not in places:
        raise ConfigurationError(f"capsules[{i}].link", given.link, f"one of the links {', '.join(places)}")
    frame, pose = places[given.link]
    ends = []
    for name in ("start", "end"):
        try:
            point = np.array(real_array(getattr(given, name)))
        except (TypeError, ValueError, OverflowError):
            point = np.empty(0)
        if point.shape != (3,):
            raise ConfigurationError(f"capsules[{i}].{name}", getattr(given, name), "three numbers [m]")
        x, y, z = (pose[:3, :3] @ point + pose[:3, 3]).tolist()
        ends.append((x, y, z))
    return LinkCapsule(given.link, frame, ends[0], ends[1], given.radius)


def _body(link: _Fixed, places: Mapping[str, tuple[int, Array]]) -> Body:
    """A link's mass, centre and inertia in the frame of its row."""
    frame, pose = places[link.step.link]
    own = link.step.inertial
    assert own is not None  # links without a mass are left out
    turn = pose[:3, :3]
    return Body(link.step.link, frame, own.mass, turn @ own.centre + pose[:3, 3], turn @ own.inertia @ turn.T)
