"""The robot, stick, room and resolver of a problem file; errors name the keys of the file."""

from __future__ import annotations

import numpy as np

from rehab_opt.control.joystick import STICK_MODES, Joystick, StickMode
from rehab_opt.control.obstacles import Disc, HalfPlane, Obstacle
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.errors import ProblemFileError, RobotFileError
from rehab_opt.kinematics import DriveName
from rehab_opt.kinematics.ardis import ARDIS_READY, ardis
from rehab_opt.kinematics.arm_on_chair import arm_on_chair
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.session.ardis.clearance import chair_gaps
from rehab_opt.session.ardis.problem import ArdisProblem, RobotSection, RunSection, StickSection
from rehab_opt.session.ardis.stick import StickRecording, read_stick
from rehab_opt.session.ardis.user import SimulatedUser
from rehab_opt.session.clearance import clearance_key, clearance_of
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.outcome import Array
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.robot_file import posture_of
from rehab_opt.session.robot_file import robot_of as arm_of
from rehab_opt.session.schema import keys_of

MAX_TICKS = 500_000
"""Largest number of ticks in a run; more would need over a gigabyte for poses and Jacobians."""

KEYS = keys_of(robot=RobotSection, stick=StickSection, run=RunSection) | {
    "dt": "run.rate_hz",
    "obstacles": "room",
    "row_sets": "stick.modes",
}
"""Keys of the problem file, by argument of the library."""


def robot_of(config: ProblemFile[ArdisProblem]) -> MobileArm:
    """ARDIS, or ARDIS's chair with the arm of a robot file, with the masses of the problem file."""
    section = config.problem.robot
    if section.file is not None:
        arm = arm_of(config, section.file)
        with refused_as(section.file, error=RobotFileError):
            return arm_on_chair(arm, mount=np.eye(4), chair_mass=section.chair_mass_kg)
    with refused_as(config.file, _key):
        return ardis(mount_height=section.mount_height_m, chair_mass=section.chair_mass_kg, payload=section.payload_kg)


def start_of(config: ProblemFile[ArdisProblem], robot: MobileArm) -> Array:
    """(7,) [m, rad] starting joint positions."""
    section, chain = config.problem.robot, robot.chain
    arm = ARDIS_READY[CHAIR:]
    if section.arm_deg is not None:
        arm = posture_of(chain, section.arm_deg, file=config.file, key="robot.arm_deg", first=CHAIR)
    q = np.array([*section.start_m, np.deg2rad(section.heading_deg), *arm])
    gaps = chair_gaps(robot.outline, room_of(config), q[None, :])
    if gaps.size and gaps.min() < 0:
        raise ProblemFileError(
            config.file, "robot.start_m", section.start_m, "a place where the chair is clear of walls and posts"
        )
    return q


def room_of(config: ProblemFile[ArdisProblem]) -> tuple[Obstacle, ...]:
    """Walls and posts, in the order of the file."""
    room = config.problem.room
    walls = [HalfPlane((wall.normal[0], wall.normal[1]), wall.offset_m) for wall in room.walls]
    return (*walls, *(Disc((post.centre_m[0], post.centre_m[1]), post.radius_m) for post in room.posts))


def joystick_of(config: ProblemFile[ArdisProblem]) -> Joystick:
    """The stick with the file's modes."""
    section = config.problem.stick
    modes: tuple[StickMode, ...] = STICK_MODES
    if section.modes is not None:
        modes = tuple(
            StickMode(mode.name, (mode.rows[0], mode.rows[1]), (mode.speeds[0], mode.speeds[1]), tuple(mode.held))
            for mode in section.modes
        )
    with refused_as(config.file, _key):
        return Joystick(modes, dt=1 / config.problem.run.rate_hz, **section.arguments("dead_zone", "rate_per_s"))


def stick_of(config: ProblemFile[ArdisProblem], drive: DriveName) -> StickRecording | SimulatedUser:
    """The drive's stick: its recording, or a new simulated user."""
    section, rate = config.problem.stick, config.problem.run.rate_hz
    file = section.recordings.get(drive)
    stick: SimulatedUser | StickRecording
    if file is None:
        stick = SimulatedUser(config.problem.goals, joystick_of(config))
    else:
        stick = read_stick(recording_path(config, file, key=f"stick.{drive}"), name=file)
    if stick.duration * rate > MAX_TICKS:
        expected = f"at most {MAX_TICKS} ticks in the {stick.duration:.6g} s of stick.{drive}"
        raise ProblemFileError(config.file, "run.rate_hz", rate, expected)
    return stick


def resolver_of(
    config: ProblemFile[ArdisProblem],
    robot: MobileArm,
    drive: DriveName,
    *,
    solver: str | None = None,
    backup: str | None = None,
) -> RedundancyResolver:
    """Controller for the modes of the file's stick, with the file's obstacles; `backup` as in `RedundancyResolver`."""
    run = config.problem.run
    chosen = run.arguments("self_motion", "solver") | ({"solver": solver} if solver else {})
    with refused_as(config.file, _key, option=solver):
        return RedundancyResolver(
            robot,
            drive=drive,
            row_sets=list(dict.fromkeys(mode.task_rows for mode in joystick_of(config).modes)),
            obstacles=room_of(config),
            limits=clearance_of(config.problem.clearance, config.file),
            dt=1 / run.rate_hz,
            backup=backup,
            # Compiling takes longer than a run; the results are the same.
            compile=False,
            **chosen,
        )


def _key(argument: str) -> str:
    own = f"stick.{argument}".replace("[", ".").replace("]", "")
    return clearance_key(argument) or KEYS.get(argument, own)
