"""Robot, reference and tracker of a problem file, each refusal in the file's words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.session.clearance import clearance_key, clearance_of
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.pose_tracking.problem import CircleSection, PoseTracking, RobotSection
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.robot_file import posture_of, robot_of
from rehab_opt.session.systems import ROBOT_FILE, Needed

if TYPE_CHECKING:
    from rehab_opt.control.joint_feedback import JointFeedback
    from rehab_opt.control.pose_tracker import PoseTracker

__all__ = ["circle_reference", "robot_at_start", "robot_files", "tracker_of"]

Array = NDArray[np.float64]

KEYS = {"gain": "tracker.gain_per_s", "dt": "tracker.rate_hz"}
"""Where the problem file says what the tracker calls by its own name."""


def tracker_of(
    problem: PoseTracking,
    robot: SerialChain,
    *,
    file: str,
    solver: str | None = None,
    backup: str | None = None,
    feedback: JointFeedback | None = None,
) -> PoseTracker:
    """The tracker with the file's parameters; `backup` and `feedback` as `PoseTracker` takes them.

    Raises
    ------
    ProblemFileError : it refuses a value of the file.
    ConfigurationError : it refuses `solver`.
    """
    from rehab_opt.control.pose_tracker import PoseTracker  # noqa: PLC0415  (loads solvers)

    given = {"gain": problem.tracker.gain_per_s, "solver": solver or problem.tracker.solver}
    chosen: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    with refused_as(file, lambda name: clearance_key(name) or KEYS.get(name, f"tracker.{name}"), option=solver):
        limits = clearance_of(problem.clearance, file, moving=True)
        return PoseTracker(
            robot, dt=1 / problem.tracker.rate_hz, limits=limits, backup=backup, feedback=feedback, **chosen
        )


def circle_reference(start: Array, circle: CircleSection, times: Array) -> tuple[Array, Array]:
    """Poses (N, 4, 4) and twists (N, 6) of a circle through the starting pose (4, 4), from rest to rest.

    The phase a runs from 0 to 2 pi turns as a minimum-jerk polynomial of time. The centre lies `radius_m` from the
    start in the direction `towards` (its part across `normal`); the tool swings about its own z axis by
    swing (1 - cos a) / 2, so that it is back in its starting orientation after every turn.
    """
    normal = np.array(circle.normal) / np.linalg.norm(circle.normal)
    towards = np.array(circle.towards) - np.dot(circle.towards, normal) * normal
    towards /= np.linalg.norm(towards)
    across = np.cross(normal, towards)
    u = times / circle.duration_s
    whole = 2 * math.pi * circle.turns
    phase = whole * (10 * u**3 - 15 * u**4 + 6 * u**5)
    phase_rate = whole * (30 * u**2 - 60 * u**3 + 30 * u**4) / circle.duration_s
    swing = math.radians(circle.swing_deg) * (1 - np.cos(phase)) / 2
    swing_rate = math.radians(circle.swing_deg) * np.sin(phase) / 2 * phase_rate

    poses = np.tile(start, (len(times), 1, 1))
    cosine, sine = np.cos(phase)[:, None], np.sin(phase)[:, None]
    poses[:, :3, 3] += circle.radius_m * ((1 - cosine) * towards + sine * across)
    turn = np.tile(np.eye(3), (len(times), 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(swing)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(swing), -np.sin(swing)
    poses[:, :3, :3] = start[:3, :3] @ turn
    twists = np.empty((len(times), 6))
    twists[:, :3] = circle.radius_m * phase_rate[:, None] * (sine * towards + cosine * across)
    twists[:, 3:] = swing_rate[:, None] * start[:3, 2]
    return poses, twists


def robot_at_start(loaded: ProblemFile[Any]) -> tuple[SerialChain, Array]:
    """The robot of a problem with the file's limits, and its starting joint values (n,) [rad].

    Raises
    ------
    ProblemFileError : it starts outside its limits, or in another number of joints than it has; its robot file cannot
        be used.
    """
    section: RobotSection = loaded.problem.robot
    speed, acceleration = math.radians(section.joint_speed_deg_s), section.joint_acceleration_deg_s2
    if section.file is None:
        robot = ur5(velocity=speed)
        if acceleration is not None:
            robot = robot.with_limits(acceleration=np.full(robot.n, math.radians(acceleration)))
    else:
        robot = robot_of(loaded, section.file)
        slower = math.inf if acceleration is None else math.radians(acceleration)
        robot = robot.with_limits(
            velocity=np.minimum(robot.velocity, speed), acceleration=np.minimum(robot.acceleration, slower)
        )
    return robot, posture_of(robot, section.start_deg, file=loaded.file, key="robot.start_deg")


def robot_files(section: RobotSection) -> tuple[Needed, ...]:
    """The robot file, where there is one."""
    return () if section.file is None else (Needed(ROBOT_FILE, section.file),)
