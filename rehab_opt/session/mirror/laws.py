"""The controllers of a mirrored hand on one reference: without a floor, tick by tick, planned as a whole, and A*."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.published.astar import AStarPath, astar_path
from rehab_opt.session.clearance import clearance_key, clearance_of, planes_of
from rehab_opt.session.live.problem import Following, LiveInputs
from rehab_opt.session.mirror.outcome import Led
from rehab_opt.session.mirror.problem import MirrorProblem, MirrorTrackerSection
from rehab_opt.session.mirror.scene import Setup
from rehab_opt.session.outcome import Array, Progress
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.schema import keys_of
from rehab_opt.session.simulation import relaxed_words, simulate
from rehab_opt.session.trace import Trace

__all__ = ["ANY_SPEED", "planned", "searched", "track_reference", "tracker_of", "without_floor"]

HELD = LiveInputs(enable=True)
ANY_SPEED = 3.0
"""[m/s] Speed limit of a hand without a floor."""
APPROACH = 5.0
"""[s] Time for the approach to the first pose."""
SETTLED = 1e-3
"""[rad/s] Joint speeds below which a motion has ended."""
ARRIVED = 2.0
"""[s] at the last pose after which a motion also ends: a hand at its floor may creep on."""
SETTLED_AMID_NOISE = 0.03
"""[rad/s] The same with encoder noise, to which commands react."""
TRACKER_KEYS = (
    "floor", "max_deviation_mm", "max_turn_deg", "linear_speed_m_s", "angular_speed_deg_s", "catch_up",
)  # fmt: skip
KEYS = keys_of(tracker=MirrorTrackerSection) | {
    "dt": "tracker.rate_hz",
    "person": "patient.arm",
    "grip": "robot.grip_deg",
    "start": "patient.arm.start_deg",
}
"""Keys of the problem file for arguments of the tracker."""


def tracker_of(
    problem: MirrorProblem, scene: Setup, *, file: str, backup: str | None = None, live: bool = False, **options: Any
) -> MirrorTracker:
    """The tracker with the file's parameters; `backup` as for `FallbackChain`, `options` are other arguments of
    `MirrorTracker`.

    With `live` it gets the person's arm, and limits the reference to it in each tick; `scene.led` is already limited.

    Raises
    ------
    ProblemFileError : the tracker refuses a value of the file.
    """
    section = problem.tracker
    planes = planes_of(section.keep_out, file, "tracker.keep_out")
    person, grip = scene.person if scene.person is not None and live else (None, None)
    arm = problem.patient.arm
    with refused_as(file, lambda name: clearance_key(name) or KEYS.get(name, f"tracker.{name}")):
        return MirrorTracker(
            scene.robot,
            **section.arguments(*TRACKER_KEYS),
            keep_out=planes,
            limits=clearance_of(problem.clearance, file),
            person=person,
            grip=grip,
            person_start=None if arm is None or arm.start_deg is None else np.deg2rad(arm.start_deg),
            dt=1.0 / section.rate_hz,
            backup=backup,
            **options,
        )


def _led(
    scene: Setup,
    ran: Trace,
    *,
    max_manipulability: float,
    complete: bool,
    counts: dict[str, int],
    **of: Array,
) -> Led:
    """A run along the scene's reference; `of` are the fields of `Led` that the trace lacks."""
    robot = scene.robot
    return Led(
        time=ran["t_s"],
        q=ran["joint"],
        command=ran["command"],
        tool=np.array([robot.pose(each) for each in ran["joint"]]),
        manipulability=np.array([robot.manipulability(each) for each in ran["joint"]]) / max_manipulability,
        status=tuple(ran["status"].tolist()),
        relaxed=tuple(map(_joined, ran["relaxed"].tolist())),
        reasons=tuple(ran["reason"].tolist()),
        seconds=ran["_seconds"],
        complete=complete,
        counts=counts,
        motion=ran if "velocity" in ran else None,
        **of,
    )


def _joined(words: str) -> str:
    return words.replace(", ", "+")


def without_floor(scene: Setup, plant: Plant, *, max_manipulability: float, progress: Progress) -> Led:
    """The reference at its own speed with only the robot's limits: the paper's comparison without a floor."""
    dt, (poses, twists) = plant.dt, (scene.reference.poses, scene.reference.twists)
    tracker = PoseTracker(scene.robot, dt=dt, linear_speed=ANY_SPEED, angular_speed=20.0)
    start, first = scene.start.copy(), poses[~scene.reference.lost][0]
    for _ in range(math.ceil(APPROACH / dt)):
        start += dt * tracker.step(start, first, np.zeros(6)).value
    tracker.reset()
    control = Following(tracker, TouchedPlant(plant), start, poses, twists, then="stay")
    ran = simulate(control, lambda _: HELD, ticks=len(poses), progress=partial(progress, "without floor"))
    none = np.zeros((len(poses), 2))
    return _led(
        scene, ran, max_manipulability=max_manipulability, complete=True, counts={}, reference=poses,
        lag=none[:, 0], pace=np.ones(len(poses)), short=none, person=none,
    )  # fmt: skip


def track_reference(tracker: MirrorTracker, scene: Setup, plant: Plant, *, patience: float, progress: Progress) -> Led:
    """Closed loop, tick by tick, without knowledge of the future.

    After the end of the recording its last pose stays, until the clock has passed it or `patience` durations have
    passed.
    """
    tracker.reset()
    tracker.counts.clear()  # they outlive a reset
    dt, led, total, arrived, complete = tracker.dt, scene.led, len(scene.led.poses), 0, False
    settled = SETTLED if isinstance(plant, IdealJoints) else SETTLED_AMID_NOISE

    def led_by(k: int, command: Command) -> dict[str, Any]:
        nonlocal arrived, complete
        arrived = arrived + 1 if k >= total and tracker.lag < (k - total + 2) * dt else 0  # the clock is past the last
        complete = arrived * dt > ARRIVED or bool(arrived and float(np.abs(command.value).max()) < settled)
        return {"reference": tracker.reference, "lag": tracker.lag, "pace": tracker.time_scale, "short": tracker.short}

    control = Following(tracker, TouchedPlant(plant), scene.start, led.poses, led.twists, then="stay")
    ran = simulate(
        control, lambda _: None if complete else HELD, ticks=math.ceil(patience * total + 2.0 / dt), also=led_by,
        progress=lambda done, _: progress("step", min(done, total), total),
    )  # fmt: skip
    lag = ran["lag"]
    reference, person = scene.reference_of(ran["reference"], ran["t_s"] - lag)
    return _led(
        scene, ran, max_manipulability=tracker.max_manipulability, complete=complete, counts=dict(tracker.counts),
        reference=reference, lag=lag, pace=ran["pace"], short=ran["short"] + person, person=person,
    )  # fmt: skip


def planned(tracker: MirrorTracker, scene: Setup, *, progress: Progress) -> Led:
    """The whole motion, planned in advance."""
    progress("plan", 0, 1)
    tracker.counts.clear()
    path = tracker.plan(scene.led.poses, scene.led.twists, scene.start)
    progress("plan", 1, 1)
    robot, (reference, person) = scene.robot, scene.reference_of(path.references, path.clock)
    return Led(
        time=path.times,
        q=path.q,
        command=path.velocities,
        tool=path.poses,
        reference=reference,
        manipulability=np.array([robot.manipulability(each) for each in path.q]) / tracker.max_manipulability,
        lag=path.times - path.clock,
        # At its end the reference stands still: a hand that settles there is not held back.
        pace=np.where(path.complete & (path.clock == path.clock[-1]), 1.0, path.paces),
        short=path.short + person,
        person=person,
        status=("planned",) * len(path.q),
        relaxed=tuple(_joined(relaxed_words(each)) for each in path.relaxed),
        reasons=("",) * len(path.q),
        seconds=np.array([path.seconds]),
        complete=path.complete,
        counts=dict(path.counts),
    )


def searched(
    problem: MirrorProblem, scene: Setup, *, max_manipulability: float, progress: Progress
) -> AStarPath | None:
    """The published A*, if the file has it, from the first posture that reaches the reference."""
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
        **section.arguments(),
    )
    progress("A*", 1, 1)
    return found
