"""The robot of a problem file, and robot files: a few lines of TOML that describe an arm from a URDF or an MJCF."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from rehab_opt.errors import ConfigurationError, ProblemFileError, RobotFileError
from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link_capsules import CapsuleOnLink
from rehab_opt.kinematics.robot_file.links import Metres, Radians
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.session.files import ProblemFile, problem_content, recording_path, schema_error
from rehab_opt.session.outcome import Array
from rehab_opt.session.schema import Problem, Section, Triple, refusal
from rehab_opt.session.systems import ROBOT_FILE

__all__ = [
    "RobotFile", "RobotSection", "pose_of", "posture_of", "robot_at_start", "robot_of", "robot_text",
]  # fmt: skip
Name = Annotated[str, Field(min_length=1, max_length=200)]
Turns = Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=3, max_length=3)]
Angle = Annotated[float, Field(ge=-720, le=720)]
UR5_JOINTS = 6
JOINT_KEYS = {
    "velocity": ("speed_deg_s",),
    "lower": ("lower_deg",),
    "upper": ("upper_deg",),
    "locked": ("locked_deg", "locked_m"),
    "effort": ("effort_n_m",),
}
"""Keys of a robot file for the arguments of `SerialChain.from_urdf` that have a value for each joint."""
GIVE = re.compile(rf"(?P<argument>{'|'.join(JOINT_KEYS)})={{'(?P<joint>[^']+)': [^}}]*}}")
"""Pattern of such an argument in an error message that advises to pass it."""


class RobotSection(Section):
    """The robot and its starting posture."""

    model: Literal["ur5"] | None = None
    """The UR5 with its vendor's limits; either this or `file`."""
    FILES: ClassVar = ("file",)
    file: str | None = Field(default=None, min_length=1)
    """A robot file, relative to the problem file; either this or `model`."""
    start_deg: Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=1, max_length=100)]
    """Starting angle of each joint."""
    joint_speed_deg_s: Annotated[float, Field(gt=0, le=180)] = 180.0
    """Largest speed of every joint; a lower limit of the robot itself stays."""
    joint_acceleration_deg_s2: Annotated[float, Field(gt=0, le=1e5)] | None = None
    """Largest acceleration of every joint; default 859 for the UR5, an assumption, since the vendor publishes none. For
    a robot file's arm it can only lower the file's value."""

    @model_validator(mode="after")
    def one_robot(self) -> Self:
        """Refuse both or neither of `model` and `file`, and a UR5 start that does not have six angles."""
        if (self.model is None) == (self.file is None):
            key, value = ("model", None) if self.file is None else ("file", self.file)
            raise refusal(key, value, "either model = 'ur5', or file = a robot file")
        if self.model is not None and len(self.start_deg) != UR5_JOINTS:
            raise refusal("start_deg", self.start_deg, f"{UR5_JOINTS} entries")
        return self


class JointSection(Section):
    """Values of one joint that the URDF lacks, or that replace the URDF's."""

    acceleration_deg_s2: float | None = Field(default=None, gt=0, le=1e5)
    """Replaces the value for all joints."""
    speed_deg_s: float | None = Field(default=None, gt=0, le=3600)
    """Replaces the file's value, or the value for all joints."""
    lower_deg: Angle | None = None
    """Replaces the file's lower limit."""
    upper_deg: Angle | None = None
    """Replaces the file's upper limit."""
    locked_deg: Angle | None = None
    """Lock the joint at this angle; it is then no joint of the chain. A joint that is coupled to another (mimic) must
    be locked if it lies between base and tip."""
    locked_m: float | None = Field(default=None, ge=-10, le=10)
    """Lock a prismatic joint at this position; a prismatic joint between base and tip must be locked."""
    effort_n_m: float | None = Field(default=None, gt=0, le=1e5)
    """Largest torque of the joint's drive, which replaces the file's value; the plant `mujoco` requires it if the file
    has none."""

    @model_validator(mode="after")
    def locked_once(self) -> Self:
        """Refuse a joint that is locked twice, or is locked and has limits."""
        if self.locked_deg is not None and self.locked_m is not None:
            raise refusal("locked_m", self.locked_m, "no such key beside locked_deg")
        if self.locked_deg is not None or self.locked_m is not None:
            for key in ("lower_deg", "upper_deg", "speed_deg_s", "acceleration_deg_s2", "effort_n_m"):
                if getattr(self, key) is not None:
                    raise refusal(key, getattr(self, key), "no such key of a joint that is locked")
        return self

    @model_validator(mode="after")
    def range_is_one(self) -> Self:
        """Refuse an upper limit below the lower one."""
        if self.lower_deg is not None and self.upper_deg is not None and self.lower_deg > self.upper_deg:
            raise refusal("lower_deg", self.lower_deg, f"no more than upper_deg = {self.upper_deg:g}")
        return self


class CapsuleSection(Section):
    """The shape of a link, in the link's own frame."""

    link: Name
    """Name of the link in the URDF, or of the body in the MJCF."""
    start_m: Triple
    """One end of the capsule's axis, in the link's own frame."""
    end_m: Triple
    """The other end."""
    radius_m: float = Field(gt=0, le=1)
    """Radius of the capsule."""


class RobotFile(Section):
    """A robot file."""

    urdf: Name | None = None
    """URDF file with links and joints, relative to this file; meshes are not read. For a xacro file, first run `xacro
    arm.urdf.xacro > arm.urdf`."""
    mjcf: Name | None = None
    """MJCF file (MuJoCo's format, needs the extra `mjcf`); either this or `urdf`."""
    base: Name | None = None
    """First link of the chain, or first body in an MJCF; default: the root."""
    tip: Name | None = None
    """Last link of the chain, or last body or site in an MJCF; default: the last link, if there is only one."""
    acceleration_deg_s2: float = Field(gt=0, le=1e5)
    """Largest acceleration of every joint: a URDF has none, so ask the vendor, or start low."""
    speed_deg_s: float | None = Field(default=None, gt=0, le=3600)
    """Largest speed of every joint, which replaces the URDF's; required for an MJCF, which has none."""
    mount_m: Triple = Field(default=[0.0, 0.0, 0.0])
    """Position of the base in the problem's frame, after the rotation `mount_deg`."""
    mount_deg: Turns = Field(default=[0.0, 0.0, 0.0])
    """Rotation about the frame's x, then y, then z axis."""
    tool_m: Triple = Field(default=[0.0, 0.0, 0.0])
    """Position of the tool in the tip's frame, after the rotation `tool_deg`."""
    tool_deg: Turns = Field(default=[0.0, 0.0, 0.0])
    """Rotation about the tip's x, then y, then z axis."""
    payload_kg: float = Field(default=0.0, ge=0, le=1000)
    """A mass at the origin of the tool. It is added to the links' masses, which the plant `mujoco` uses."""
    joints: dict[Name, JointSection] = Field(default={}, max_length=100)
    """Values of single joints, by joint name, that the file lacks or that replace the file's."""
    capsules: list[CapsuleSection] = Field(default=[], max_length=50)
    """Shapes of the links. Of a link without a capsule, only the origins of its frames are kept clear of bodies."""
    collision: bool = False
    """Use capsules around the cylinders, boxes and spheres of the URDF's `<collision>` instead of `capsules`."""

    @model_validator(mode="after")
    def one_model(self) -> Self:
        """Refuse both or neither of `urdf` and `mjcf`, and an MJCF without `speed_deg_s`, which this format lacks."""
        if (self.urdf is None) == (self.mjcf is None):
            raise refusal("urdf", self.urdf, "either urdf or mjcf, the file with the robot's links")
        if self.mjcf is not None and self.speed_deg_s is None:
            raise refusal("speed_deg_s", None, "the joints' largest speed, which an MJCF does not have")
        if self.collision and (self.capsules or self.urdf is None):
            raise refusal("collision", True, "a URDF, and no capsules beside it")
        return self


def robot_at_start(config: ProblemFile[Any]) -> tuple[SerialChain, Array]:
    """The robot of a problem with the file's limits, and its starting joint positions (n,) [rad].

    Raises
    ------
    ProblemFileError : the start is outside the limits or has the wrong number of joints; the robot file is invalid.
    """
    section: RobotSection = config.problem.robot
    speed, acceleration = math.radians(section.joint_speed_deg_s), section.joint_acceleration_deg_s2
    if section.file is None:
        robot = ur5(velocity=speed)
        if acceleration is not None:
            robot = robot.with_limits(acceleration=np.full(robot.n, math.radians(acceleration)))
    else:
        robot = robot_of(config, section.file)
        slower = math.inf if acceleration is None else math.radians(acceleration)
        robot = robot.with_limits(
            velocity=np.minimum(robot.velocity, speed), acceleration=np.minimum(robot.acceleration, slower)
        )
    return robot, posture_of(robot, section.start_deg, file=config.file, key="robot.start_deg")


def robot_of(config: ProblemFile[Any], reference: str) -> SerialChain:
    """The arm of the robot file that a problem names as `robot.file`.

    Raises
    ------
    ProblemFileError : the robot file is missing or invalid. RobotFileError : its URDF or MJCF is missing or invalid.
    """
    path = recording_path(config, reference, key=ROBOT_FILE)
    try:
        said = RobotFile.model_validate(problem_content(path, reference))
    except ValidationError as problem:
        raise schema_error(problem, reference) from problem
    return _arm(said, path, reference)


def robot_text(config: ProblemFile[Problem], reference: str) -> str:
    """Every number of a problem's arm as one text, which changes only if one of its files changes."""
    arm = robot_of(config, reference)
    bodies = [(each.name, each.link, each.mass, each.centre.tolist(), each.inertia.tolist()) for each in arm.bodies]
    parts = [
        arm.names, *((row.prismatic, np.array(row.after).tolist()) for row in arm.rows),
        *(array.tolist() for array in (arm.base, arm.tool, arm.lower, arm.upper, arm.velocity, arm.acceleration)),
        arm.effort.tolist(), arm.capsules, bodies,
    ]  # fmt: skip
    return repr(parts)


def posture_of(chain: SerialChain, degrees: list[float], *, file: str, key: str, first: int = 0) -> Array:
    """Angles (m,) [rad] of the chain's joints from index `first` on, converted from `degrees`, the value of `key`.

    Raises
    ------
    ProblemFileError : wrong number of joints, or a value outside their limits.
    """
    names, lower, upper = chain.names[first:], chain.lower[first:], chain.upper[first:]
    if len(degrees) != len(names):
        raise ProblemFileError(file, key, degrees, f"{len(names)} entries, of {', '.join(names)}")
    q: Array = np.deg2rad(degrees)
    outside = np.flatnonzero((q < lower) | (q > upper))
    if outside.size:
        joint = int(outside[0])
        low, high = np.rad2deg(lower[joint]), np.rad2deg(upper[joint])
        raise ProblemFileError(file, f"{key}.{joint}", degrees[joint], f"{names[joint]} within {low:g} to {high:g} deg")
    return q


def pose_of(angles_deg: list[float], place: list[float]) -> Array:
    """(4, 4) rotation about x, then y, then z of the fixed frame [deg], followed by a translation [m]."""
    pose = np.eye(4)
    for angle, (i, j) in zip(np.deg2rad(angles_deg), ((1, 2), (2, 0), (0, 1)), strict=True):
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[i, j], turn[j, i] = -math.sin(angle), math.sin(angle)
        pose[:3, :3] = turn @ pose[:3, :3]
    pose[:3, 3] = place
    return pose


def _arm(said: RobotFile, path: Path, name: str) -> SerialChain:
    model = said.urdf if said.urdf is not None else said.mjcf
    assert model is not None  # the schema requires one of the two
    file = path.parent / model
    if not file.is_file():
        raise RobotFileError(
            name, "mjcf" if said.urdf is None else "urdf", model, "a file beside this one: it is not there, or no file"
        )
    capsules = [CapsuleOnLink(each.link, *_ends(each), each.radius_m) for each in said.capsules]
    speeds = {key: each.speed_deg_s for key, each in said.joints.items()}
    turned = _radians({key: each.locked_deg for key, each in said.joints.items()})
    slid = {key: Metres(each.locked_m) for key, each in said.joints.items() if each.locked_m is not None}
    any_file: Callable[..., SerialChain] = SerialChain.from_urdf if said.urdf is not None else SerialChain.from_mjcf
    read = partial(
        any_file,
        file,
        **said.arguments("base", "tip"),
        lower=_radians({key: each.lower_deg for key, each in said.joints.items()}),
        upper=_radians({key: each.upper_deg for key, each in said.joints.items()}),
        locked={key: Radians(value) for key, value in turned.items()} | slid,
        mount=pose_of(said.mount_deg, said.mount_m),
        tool=pose_of(said.tool_deg, said.tool_m),
        capsules="collision" if said.collision else capsules,
        effort={key: each.effort_n_m for key, each in said.joints.items() if each.effort_n_m is not None},
    )
    of_all = said.arguments("acceleration_deg_s2", "speed_deg_s", speed_deg_s="velocity")
    try:
        arm = read(**{"velocity": _radians(speeds), **of_all})
    except RobotFileError as refused:
        raise RobotFileError(refused.file, refused.key, refused.value, _advice(refused.expected)) from refused
    except ConfigurationError as refused:
        raise RobotFileError(name, *_key_and_value(said, refused), _advice(refused.expected)) from refused
    slides = [joint for joint, row in zip(arm.names, arm.rows, strict=True) if row.prismatic]
    if slides:
        expected = "its locked position: problem files move only revolute joints"
        raise RobotFileError(name, f"joints.{slides[0]}.locked_m", None, expected)
    unknown = sorted(said.joints.keys() - {*arm.names, *turned, *slid})
    if unknown:
        section = said.joints[unknown[0]]
        key = next((each for each in type(section).model_fields if getattr(section, each) is not None), None)
        where, value = ("joints", unknown[0]) if key is None else (f"joints.{unknown[0]}.{key}", getattr(section, key))
        raise RobotFileError(name, where, value, f"joint names among {', '.join(arm.names)}")
    own = {
        "velocity": speeds,
        "acceleration": {key: each.acceleration_deg_s2 for key, each in said.joints.items() if key in arm.names},
    }
    # Read again with each joint's own values, so that the reader's notes are about the limits that apply.
    arm = read(**{
        key: (dict.fromkeys(arm.names, of_all[key]) if key in of_all else {}) | _radians(values)
        for key, values in own.items()
    })  # fmt: skip
    bodies = (Body("payload", arm.n, said.payload_kg, arm.tool[:3, 3], np.zeros((3, 3))),) if said.payload_kg else ()
    return replace(arm, bodies=(*arm.bodies, *bodies))


def _radians(degrees: dict[str, float | None]) -> dict[str, float]:
    return {key: math.radians(value) for key, value in degrees.items() if value is not None}


def _ends(capsule: CapsuleSection) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    (a, b, c), (d, e, f) = capsule.start_m, capsule.end_m
    return (a, b, c), (d, e, f)


def _advice(expected: str) -> str:
    """Text of a URDF or MJCF reader's error, with keys of the robot file in place of arguments."""
    return GIVE.sub(lambda found: f"[joints.{found['joint']}] {JOINT_KEYS[found['argument']][0]} = ...", expected)


def _key_and_value(said: RobotFile, refused: ConfigurationError) -> tuple[str, object]:
    """Key of the robot file for an argument of the reader, and its value there."""
    first, _, rest = refused.argument.partition("[")
    if first not in JOINT_KEYS:
        known = {"file": "mjcf"}.get(first, first) if said.capsules or first != "capsules" else "collision"
        return (known if not rest else f"{known}.{rest.replace(']', '')}"), refused.value
    joint = refused.value if isinstance(refused.value, str) else rest.strip("']\"")
    section = said.joints.get(str(joint))
    if section is None:
        return "joints", refused.value
    keys = JOINT_KEYS[first]
    key = next((each for each in keys if getattr(section, each) is not None), keys[0])
    return f"joints.{joint}.{key}", getattr(section, key)
