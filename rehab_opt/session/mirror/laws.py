"""Runs of a mirrored hand along one reference: without a manipulability floor, tick by tick, and planned in advance."""

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
from rehab_opt.session.clearance import clearance_key, clearance_of, planes_of
from rehab_opt.session.live.problem import Following, LiveInputs
from rehab_opt.session.mirror.problem import MirrorProblem, MirrorTrackerSection
from rehab_opt.session.mirror.scene import Setup
from rehab_opt.session.outcome import Progress, turn_angles
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.schema import keys_of
from rehab_opt.session.simulation import relaxed_words, simulate
from rehab_opt.session.trace import Trace

BEFORE, STEP, PLAN = "without floor", "step", "plan"
LAWS = (BEFORE, STEP, PLAN)
"""Names of the controllers, in the order of the figures; A* is not among them, since its path has no times."""
HELD = LiveInputs(enable=True)
ANY_SPEED = 3.0
"""[m/s] Speed limit of the hand for the controller without a manipulability floor."""
APPROACH = 5.0
"""[s] Time for the approach to the first pose."""
SETTLED = 1e-3
"""[rad/s] Joint speeds below which a motion has ended."""
ARRIVED = 2.0
"""[s] A motion also ends after this time at the last pose, since a hand at the manipulability floor may creep on."""
SETTLED_AMID_NOISE = 0.03
"""[rad/s] `SETTLED` for encoders with noise, to which the commands react."""
TRACKER_KEYS = (
    "floor", "max_deviation_mm", "max_turn_deg", "linear_speed_m_s", "angular_speed_deg_s", "catch_up",
)  # fmt: skip
KEYS = keys_of(tracker=MirrorTrackerSection) | {
    "dt": "tracker.rate_hz",
    "person": "patient.arm",
    "grip": "robot.grip_deg",
    "start": "patient.arm.start_deg",
}
"""Keys of the problem file, by argument of the tracker."""


def tracker_of(
    problem: MirrorProblem, setup: Setup, *, file: str, backup: str | None = None, live: bool = False, **options: Any
) -> MirrorTracker:
    """The tracker with the file's parameters; `backup` as in `FallbackChain`, `options` as in `MirrorTracker`.

    With `live`, the tracker limits the reference in each tick to what the person's arm can reach. Without it, the
    reference must be `setup.led`, which is limited in advance.
    """
    section = problem.tracker
    planes = planes_of(section.keep_out, file, "tracker.keep_out")
    person, grip = setup.person if setup.person is not None and live else (None, None)
    with refused_as(file, lambda name: clearance_key(name) or KEYS.get(name, f"tracker.{name}")):
        return MirrorTracker(
            setup.robot,
            **section.arguments(*TRACKER_KEYS),
            keep_out=planes,
            limits=clearance_of(problem.clearance, file),
            person=person,
            grip=grip,
            person_start=problem.patient.arm_start,
            dt=1.0 / section.rate_hz,
            backup=backup,
            **options,
        )


def led_trace(setup: Setup, ran: Trace, *, max_manipulability: float, **of: Any) -> Trace:
    """Trace of a run along the reference, a row for each tick; cells are empty where the reference is lost.

    These columns are only kept in memory: the poses `_tool` and `_reference` (N, 4, 4); `_short` (N, 2) [m, rad], the
    smallest deviation that person and robot allow; `_person` (N, 2), the part of `_short` due to the person's arm;
    `_reason`; `_seconds` (N,) or (1,), the computing time; `_complete`, whether the reference's end was reached;
    `_velocity`, the true joint velocities of a robot that does not move as commanded.

    Parameters
    ----------
    ran : trace with the columns t_s, joint, command, status, relaxed, reason and _seconds.
    of : values of reference, lag, pace, short, person and complete; counts of waits, skips and so on; tool, if known.
    """
    robot, q, reference = setup.robot, ran["joint"], of["reference"]
    tool = of["tool"] if "tool" in of else np.array([robot.pose(each) for each in q])
    trace = Trace(
        {
            "t_s": ran["t_s"],
            "lag_s": of["lag"],
            "pace": of["pace"],
            "reference": reference[:, :3, 3],
            "tool": tool[:, :3, 3],
            "deviation_m": np.linalg.norm(tool[:, :3, 3] - reference[:, :3, 3], axis=1),
            "turn_rad": turn_angles(tool[:, :3, :3], reference[:, :3, :3]),
            "manipulability": np.array([robot.manipulability(each) for each in q]) / max_manipulability,
            "status": ran["status"],
            "relaxed": [words.replace(", ", "+") for words in ran["relaxed"].tolist()],
            "joint": q,
            "command": ran["command"],
            "_tool": tool,
            "_reference": reference,
            "_reason": ran["reason"],
            "_seconds": ran["_seconds"],
            **{f"_{name}": of[name] for name in ("short", "person", "complete", "counts")},
        },
        {"joint": [f"{name}_rad" for name in robot.names], "command": [f"{name}_rad_s" for name in robot.names]},
    )
    if "velocity" in ran:
        trace["_velocity"] = ran["velocity"]
    return trace


def without_floor(setup: Setup, plant: Plant, *, max_manipulability: float, progress: Progress) -> Trace:
    """Track the reference at its own speed with the robot's limits alone, as the paper does for comparison."""
    dt, (poses, twists) = plant.dt, (setup.reference.poses, setup.reference.twists)
    tracker = PoseTracker(setup.robot, dt=dt, linear_speed=ANY_SPEED, angular_speed=20.0)
    start, first = setup.start.copy(), poses[~setup.reference.lost][0]
    for _ in range(math.ceil(APPROACH / dt)):
        start += dt * tracker.step(start, first, np.zeros(6)).value
    tracker.reset()
    control = Following(tracker, TouchedPlant(plant), start, poses, twists, then="stay")
    ran = simulate(control, lambda _: HELD, ticks=len(poses), progress=partial(progress, BEFORE))
    none = np.zeros((len(poses), 2))
    return led_trace(
        setup, ran, max_manipulability=max_manipulability, complete=True, counts={}, reference=poses, lag=none[:, 0],
        pace=np.ones(len(poses)), short=none, person=none,
    )  # fmt: skip


def track_reference(
    tracker: MirrorTracker, setup: Setup, plant: Plant, *, patience: float, progress: Progress
) -> Trace:
    """Track the reference in closed loop, tick by tick, without knowledge of the future.

    After the recording's end, its last pose remains the reference. The run ends when the robot has arrived there, or
    after `patience` times the recording's duration.
    """
    tracker.reset()
    tracker.counts.clear()  # `reset` keeps the counts
    dt, led, total, arrived, complete = tracker.dt, setup.led, len(setup.led.poses), 0, False
    settled = SETTLED if isinstance(plant, IdealJoints) else SETTLED_AMID_NOISE

    def led_by(k: int, command: Command) -> dict[str, Any]:
        nonlocal arrived, complete
        arrived = arrived + 1 if k >= total and tracker.lag < (k - total + 2) * dt else 0  # past the last pose
        complete = arrived * dt > ARRIVED or bool(arrived and float(np.abs(command.value).max()) < settled)
        return {"reference": tracker.reference, "lag": tracker.lag, "pace": tracker.time_scale, "short": tracker.short}

    control = Following(tracker, TouchedPlant(plant), setup.start, led.poses, led.twists, then="stay")
    ran = simulate(
        control, lambda _: None if complete else HELD, ticks=math.ceil(patience * total + 2.0 / dt), also=led_by,
        progress=lambda done, _: progress("step", min(done, total), total),
    )  # fmt: skip
    reference, person = setup.reference_of(ran["reference"], ran["t_s"] - ran["lag"])
    return led_trace(
        setup, ran, max_manipulability=tracker.max_manipulability, complete=complete, counts=dict(tracker.counts),
        reference=reference, lag=ran["lag"], pace=ran["pace"], short=ran["short"] + person, person=person,
    )  # fmt: skip


def planned(tracker: MirrorTracker, setup: Setup, *, progress: Progress) -> Trace:
    """Trace of the motion that is planned as a whole in advance."""
    progress("plan", 0, 1)
    tracker.counts.clear()
    path = tracker.plan(setup.led.poses, setup.led.twists, setup.start)
    progress("plan", 1, 1)
    reference, person = setup.reference_of(path.references, path.clock)
    ran = Trace(
        {
            "t_s": path.times, "joint": path.q, "command": path.velocities, "status": ["planned"] * len(path.q),
            "relaxed": [relaxed_words(each) for each in path.relaxed], "reason": [""] * len(path.q),
            "_seconds": [path.seconds],
        }
    )  # fmt: skip
    # The reference stands still at its end, which does not count as slowed.
    pace = np.where(path.complete & (path.clock == path.clock[-1]), 1.0, path.paces)
    return led_trace(
        setup, ran, max_manipulability=tracker.max_manipulability, complete=path.complete, counts=dict(path.counts),
        reference=reference, lag=path.times - path.clock, pace=pace, short=path.short + person, person=person,
        tool=path.poses,
    )  # fmt: skip
