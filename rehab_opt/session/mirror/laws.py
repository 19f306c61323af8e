"""The laws of a mirrored hand on one reference: without a floor, tick by tick, planned as a whole, and A*."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Bound
from rehab_opt.control.hand_bounds import KeepOut
from rehab_opt.control.joint_feedback import JointFeedback
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Plant
from rehab_opt.published.astar import AStarPath, astar_path
from rehab_opt.session.clearance import clearance_key, clearance_of
from rehab_opt.session.mirror.outcome import Led
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import Scene
from rehab_opt.session.outcome import Progress
from rehab_opt.session.plant.motion import MotionLog

__all__ = ["followed", "planned", "searched", "tracker_of", "without_floor"]

Array = NDArray[np.float64]

TICKS_A_REPORT = 200
SETTLED = 1e-3
"""[rad/s] Joint speeds at which a motion has come to its end."""
ARRIVED = 2.0
"""[s] at the last pose after which a motion has come to its end, too: a hand at its floor may go on creeping."""
SETTLED_AMID_NOISE = 0.03
"""[rad/s] The same where encoders have noise, which commands answer."""
KEYS = {
    "dt": "tracker.rate_hz",
    "max_deviation": "tracker.max_deviation_mm",
    "max_turn": "tracker.max_turn_deg",
    "linear_speed": "tracker.linear_speed_m_s",
    "angular_speed": "tracker.angular_speed_deg_s",
    "person": "patient.arm",
    "grip": "robot.grip_deg",
    "start": "patient.arm.start_deg",
}
"""Where the problem file says what the tracker calls by its own name."""


def tracker_of(
    problem: MirrorProblem, scene: Scene, *, file: str, backup: str | None = None, **options: Any
) -> MirrorTracker:
    """The tracker with the file's parameters; `backup` as for `Ladder`, `options` are further ones of `MirrorTracker`.

    Raises
    ------
    ProblemFileError : it refuses a value of the file.
    """
    section = problem.tracker
    planes = []
    for i, each in enumerate(section.keep_out):
        try:
            planes.append(KeepOut.through(each.point_m, each.normal))
        except ConfigurationError as refused:
            raise ProblemFileError(file, f"tracker.keep_out.{i}.normal", each.normal, "a direction") from refused
    person, grip = scene.person if scene.person is not None else (None, None)
    arm = problem.patient.arm
    try:
        return MirrorTracker(
            scene.robot,
            floor=section.floor,
            max_deviation=1e-3 * section.max_deviation_mm,
            max_turn=math.radians(section.max_turn_deg),
            linear_speed=section.linear_speed_m_s,
            angular_speed=math.radians(section.angular_speed_deg_s),
            catch_up=section.catch_up,
            keep_out=planes,
            limits=clearance_of(problem.clearance, file),
            person=person,
            grip=grip,
            person_start=None if arm is None or arm.start_deg is None else np.deg2rad(arm.start_deg),
            dt=1.0 / section.rate_hz,
            backup=backup,
            **options,
        )
    except ConfigurationError as refused:
        key = clearance_key(refused.argument) or KEYS.get(refused.argument, f"tracker.{refused.argument}")
        raise ProblemFileError(file, key, refused.value, refused.expected) from refused


def said(yielded: Bound) -> str:
    """What had to give way, in words; nothing where nothing did."""
    return str(yielded.name).lower().replace("|", "+") if yielded else ""


class _Diary:
    """What happens in a run, tick by tick."""

    def __init__(self, scene: Scene, max_manipulability: float, plant: Plant) -> None:
        self.scene, self.max_manipulability = scene, max_manipulability
        self.plant, self.log = plant, MotionLog(plant)
        self.rows: list[tuple[Any, ...]] = []

    def note(
        self,
        reference: Array,
        command: Any,
        *,
        seconds: float,
        lag: float = 0.0,
        pace: float = 1.0,
        short: tuple[float, float] = (0.0, 0.0),
        person: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """One tick, before its command is sent."""
        what, q = said(command.yielded), self.plant.truth.position
        self.log.note(command.value)
        self.rows.append(
            (q, command.value, reference, lag, pace, short, person, command.status.value, what, command.reason, seconds)
        )

    def led(self, dt: float, *, complete: bool, counts: dict[str, int]) -> Led:
        q, command, reference, lag, pace, short, person, status, yielded, reasons, seconds = zip(
            *self.rows, strict=True
        )
        joints = np.array(q)
        robot = self.scene.robot
        return Led(
            time=np.asarray(dt * np.arange(len(joints)), dtype=np.float64),
            q=joints,
            command=np.array(command),
            tool=np.array([robot.pose(each) for each in joints]),
            reference=np.array(reference),
            manipulability=np.array([robot.manipulability(each) for each in joints]) / self.max_manipulability,
            lag=np.array(lag),
            pace=np.array(pace),
            short=np.array(short),
            person=np.array(person),
            status=status,
            yielded=yielded,
            reasons=reasons,
            seconds=np.array(seconds),
            complete=complete,
            counts=counts,
            motion=self.log.motion,
        )


def without_floor(
    scene: Scene, plant: Plant, *, max_manipulability: float, progress: Progress, feedback: JointFeedback | None = None
) -> Led:
    """The reference as it is, at its own pace, followed within the robot's limits alone: what the paper has before."""
    dt = plant.dt
    tracker = PoseTracker(scene.robot, dt=dt, linear_speed=3.0, angular_speed=20.0, feedback=feedback)
    diary, seen = _Diary(scene, max_manipulability, plant), plant.reset(scene.start)
    total = len(scene.reference.poses)
    for k, (pose, twist) in enumerate(zip(scene.reference.poses, scene.reference.twists, strict=True)):
        began = time.perf_counter()
        command = tracker.step(seen.position, pose, twist)
        spent = time.perf_counter() - began
        diary.note(pose, command, seconds=spent)
        seen = plant.step(command.value)
        if k % TICKS_A_REPORT == 0:
            progress("without floor", k, total)
    progress("without floor", total, total)
    return diary.led(dt, complete=True, counts={})


def followed(tracker: MirrorTracker, scene: Scene, plant: Plant, *, patience: float, progress: Progress) -> Led:
    """Closed loop: tick by tick, the future unknown.

    After the recording's end its last pose stays, until the clock has come there or `patience` recordings have passed.
    """
    tracker.reset()
    tracker.counts.clear()  # they outlive a reset
    dt, still = tracker.dt, np.zeros(6)
    poses, twists = scene.reference.poses, scene.reference.twists
    end = poses[~scene.reference.lost][-1]
    diary, seen = _Diary(scene, tracker.max_manipulability, plant), plant.reset(scene.start)
    settled = SETTLED if isinstance(plant, IdealJoints) else SETTLED_AMID_NOISE
    total, complete, arrived = len(poses), False, 0
    for k in range(math.ceil(patience * total + 2.0 / dt)):
        pose, twist = (poses[k], twists[k]) if k < total else (end, still)
        began = time.perf_counter()
        command = tracker.step(seen.position, pose, twist)
        spent = time.perf_counter() - began
        diary.note(
            tracker.reference,
            command,
            lag=tracker.lag,
            pace=tracker.time_scale,
            short=tracker.short,
            person=tracker.beyond_person,
            seconds=spent,
        )
        seen = plant.step(command.value)
        if k % TICKS_A_REPORT == 0:
            progress("step", min(k, total), total)
        arrived = arrived + 1 if k >= total and tracker.lag < 2 * dt else 0
        if arrived * dt > ARRIVED or (arrived and float(np.abs(command.value).max()) < settled):
            complete = True
            break
    progress("step", total, total)
    return diary.led(dt, complete=complete, counts=dict(tracker.counts))


def planned(tracker: MirrorTracker, scene: Scene, *, progress: Progress) -> Led:
    """The whole motion, the future known."""
    progress("plan", 0, 1)
    tracker.counts.clear()
    path = tracker.plan(scene.reference.poses, scene.reference.twists, scene.start)
    progress("plan", 1, 1)
    robot = scene.robot
    return Led(
        time=path.times,
        q=path.q,
        command=path.velocities,
        tool=path.poses,
        reference=path.references,
        manipulability=np.array([robot.manipulability(each) for each in path.q]) / tracker.max_manipulability,
        lag=path.times - path.clock,
        # At its end the reference stands still: a hand that settles there is not held back.
        pace=np.where(path.complete & (path.clock == path.clock[-1]), 1.0, path.paces),
        short=path.short,
        person=path.person,
        status=("planned",) * len(path.q),
        yielded=tuple(map(said, path.yielded)),
        reasons=("",) * len(path.q),
        seconds=np.array([path.seconds]),
        complete=path.complete,
        counts=dict(path.counts),
    )


def searched(
    problem: MirrorProblem, scene: Scene, *, max_manipulability: float, progress: Progress
) -> AStarPath | None:
    """The published A*, where it was asked for, from the first posture that reaches the reference."""
    section = problem.astar
    if section is None:
        return None
    progress("A*", 0, 1)
    poses = scene.reference.poses[~scene.reference.lost]
    found = astar_path(
        scene.robot,
        poses,
        scene.start,
        floor=problem.tracker.floor,
        max_manipulability=max_manipulability,
        resolution=1e-3 * section.resolution_mm,
        stretch=1e-3 * section.stretch_mm,
        pull=section.pull,
        most=section.most,
    )
    progress("A*", 1, 1)
    return found
