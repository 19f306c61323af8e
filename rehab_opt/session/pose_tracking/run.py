"""The run of `system = "pose_tracking"`: a robot whose tool follows a path, and what it did."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.command import Command
from rehab_opt.control.conditioning import conditioned
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import MOVING
from rehab_opt.kinematics.vr import quaternions_of
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.recordings.reading import read_recording
from rehab_opt.recordings.recording import Recording
from rehab_opt.session.clearance import (
    ClearanceSection,
    NearestBodies,
    clearance_key,
    clearance_of,
    nearest_bodies,
)
from rehab_opt.session.closed_loop import JointMotion, simulate
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.live.bodies import ARM_PLOTS, BLUE, ORANGE, ArmBodies, joint_rows, kept_off, moving_rows, screen
from rehab_opt.session.live.problem import Following, LiveControl, LiveInputs, LiveProblem
from rehab_opt.session.outcome import (
    Array,
    Column,
    MovementOutcome,
    Progress,
    error_metrics,
    joint_columns,
    joint_metrics,
    point_columns,
    status_counts,
    time_metrics,
    turn_angles,
)
from rehab_opt.session.plant import JointPlant, device_of, joint_plant, plant_note
from rehab_opt.session.pose_tracking.problem import MAX_TICKS, CircleSection, PathSection, PoseTracking
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.robot_file import robot_at_start, robot_files
from rehab_opt.session.systems import Needed, NotMet, System

__all__ = ["LivePoseTracking", "PoseTrackingSystem", "RobotOutcome", "circle_reference", "tracker_of"]


KEYS = {"gain": "tracker.gain_per_s", "dt": "tracker.rate_hz", "linear_speed": "tracker.linear_speed_m_s"}
"""Where the problem file says what the tracker calls by its own name."""


def tracker_of(
    problem: PoseTracking,
    robot: SerialChain,
    *,
    file: str,
    solver: str | None = None,
    backup: str | None = None,
) -> PoseTracker:
    """The tracker with the file's parameters; `backup` as `PoseTracker` takes it.

    Raises
    ------
    ProblemFileError : it refuses a value of the file.
    ConfigurationError : it refuses `solver`.
    """
    chosen = problem.tracker.arguments("gain_per_s", "linear_speed_m_s", "solver") | (
        {"solver": solver} if solver else {}
    )
    with refused_as(file, lambda name: clearance_key(name) or KEYS.get(name, f"tracker.{name}"), option=solver):
        limits = clearance_of(problem.clearance, file, moving=True)
        return PoseTracker(robot, dt=1 / problem.tracker.rate_hz, limits=limits, backup=backup, **chosen)


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


STAYS = 1.0
"""[s] for which a path's end is asked for, so that the tool comes to it."""
FASTEST, NOISE, NO_SPEED = 5.0, 0.02, 1e6
"""[m/s, m] From one sample of a path to the next, and what a sensor's noise may add; no such bound."""
APPROACH, STEP = 0.1, 0.02
"""[m/s] At most, of a tool that comes to its path's beginning, in minimum jerk; [s] between its places on the way."""


def recorded_path(config: ProblemFile[PoseTracking], path: PathSection) -> Recording:
    """The file's points in space, with notes on what was strange about them.

    Raises
    ------
    ProblemFileError : a file that is absent, cannot be read, or is too long.
    """
    rate = config.problem.tracker.rate_hz
    try:
        place = recording_path(config, path.file, key="path.file")
        recording = read_recording(place, name=path.file, **path.reading())
    except ProblemFileError as refused:
        if not refused.key.startswith("recording."):
            raise  # a line or a column of the file itself
        key = refused.key.replace("recording", "path", 1)
        expected = refused.expected.replace("recording.", "path.")
        raise ProblemFileError(config.file, key, refused.value, expected) from refused
    if recording.points.shape[1] < 2:
        raise ProblemFileError(config.file, "path.columns", path.columns, "the columns that hold x, y (and z)")
    if recording.duration * rate > MAX_TICKS:
        expected = f"at most {MAX_TICKS} ticks in the path's {recording.duration:g} s"
        raise ProblemFileError(config.file, "tracker.rate_hz", rate, expected)
    return recording


def path_reference(recording: Recording, path: PathSection, start: Array, rate: float) -> tuple[Array, Array]:
    """Poses (N, 4, 4) and twists (N, 6) along the points at `rate` [Hz], turned as the starting pose (4, 4).

    Raises
    ------
    ProblemFileError : points that jump, or too few of them.
    """
    points = np.zeros((len(recording.time) + 1, 3))
    points[:-1, : recording.points.shape[1]] = recording.points
    points[-1] = points[-2]
    time = np.append(recording.time, recording.time[-1] + STAYS)
    if path.from_start:
        points += start[:3, 3] - points[0]
    else:
        away = float(np.linalg.norm(points[0] - start[:3, 3]))
        u = np.linspace(0.0, 1.0, 2 + math.ceil(1.875 * away / (APPROACH * STEP)))
        come = (10 * u**3 - 15 * u**4 + 6 * u**5)[:-1, None]
        points = np.concatenate([start[:3, 3] + come * (points[0] - start[:3, 3]), points])
        time = np.concatenate([time[0] + STEP * np.arange(1 - len(u), 0), time])
    turn = np.tile(quaternions_of(start[None, :3, :3]), (len(time), 1))
    jumps = np.linalg.norm(np.diff(points, axis=0), axis=1) > FASTEST * np.diff(time) + NOISE
    if jumps.any():
        value = f"a jump at {time[jumps.argmax()]:.6g} s"
        raise ProblemFileError(path.file, "points", value, f"a path without, at most {FASTEST:g} m/s fast")
    whole = {"max_gap": time[-1] - time[0] + 1, "max_speed": NO_SPEED}
    with refused_as(path.file):
        found = conditioned(time, points, turn, dt=1 / rate, cutoff_hz=path.cutoff_hz, **whole)
    return found.poses, found.twists


class LivePoseTracking(LiveProblem):
    """A `PoseTracker` with the file's robot and plant."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, config: ProblemFile[PoseTracking], *, solver: str | None) -> None:
        self._config, self._solver, self.title = config, solver, config.problem.title
        self.robot, self.start = robot_at_start(config)
        self.dt, self.device = 1 / config.problem.tracker.rate_hz, device_of(config.problem.plant)
        self.names = tuple(self.robot.names)
        self.layout = {"q": self.robot.n, "target": 3, "force": 3}
        self._arm, around = ArmBodies(self.robot), config.problem.clearance
        self._moving = around if around is not None and around.moving else None
        if self._moving is not None:
            self.layout["bodies"] = self._moving.moving_at(0.0).size

    @cached_property
    def recording(self) -> Recording | None:
        """What the path's file holds; none of a circle."""
        path = self._config.problem.path
        return None if path is None else recorded_path(self._config, path)

    @cached_property
    def reference(self) -> tuple[Array, Array]:
        """Poses (N, 4, 4) and twists (N, 6) of one pass of the path, from rest to rest."""
        problem = self._config.problem
        start, rate, circle = self.robot.pose(self.start), problem.tracker.rate_hz, problem.circle
        if problem.path is not None and self.recording is not None:
            return path_reference(self.recording, problem.path, start, rate)
        assert circle is not None  # the schema asks for either
        times = self.dt * np.arange(round(circle.duration_s * rate) + 1, dtype=np.float64)
        return circle_reference(start, circle, times)

    def control(self, plant: Plant | None = None) -> LiveControl:
        """The tracker of `rehab-opt run`."""
        problem = self._config.problem
        tracker = tracker_of(problem, self.robot, file=self._config.file, solver=self._solver)
        plant = TouchedPlant(joint_plant(problem.plant, self.robot, self.dt)) if plant is None else plant
        followed = plant, self.start, *self.reference
        if self._moving is None:
            return Following(tracker, *followed, then="again")
        return _AmongMoving(tracker, self._moving, *followed)

    def scene(self) -> dict[str, Any]:
        """The path, what stands still, the joints' limits, what is plotted."""
        path = self.reference[0][:: max(1, round(0.05 / self.dt)), :3, 3]
        around = clearance_of(self._config.problem.clearance, self._config.file, moving=True)
        bodies = kept_off(path.mean(axis=0), around)
        return {
            **super().scene(),
            **bodies,
            "lines": [{"points": path.round(4).tolist(), "colour": BLUE, "name": "reference"}, *bodies["lines"]],
            "screen": screen(path),
            "joints": joint_rows(self.robot),
            "noise": "mrad",
            "plots": [
                {"name": "position error", "unit": "mm", "least": 1.0},
                *ARM_PLOTS,
            ],
            "centre": [*(0.5 * self._arm.tool(self.start)[:, 3]).round(3).tolist()],
            "reach": 1.2,
        }

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """The robot, what moves, its target, the push."""
        q, target, force = shown["q"], shown["target"], shown["force"]
        hand = self._arm.tool(q)[:, 3]
        margin = float(np.minimum(q - self.robot.lower, self.robot.upper - q).min())
        numbers = (
            1e3 * float(np.linalg.norm(hand - target)), math.degrees(margin), self.robot.manipulability(q),
            float(np.linalg.norm(force)),
        )  # fmt: skip
        return {
            "capsules": self._arm.capsules(q) + moving_rows(shown.get("bodies", np.zeros(0)).reshape(-1, MOVING)),
            "handles": {"target": target.round(4).tolist(), "hand": hand.round(4).tolist()},
            "arrows": [[*hand.tolist(), *force.tolist(), ORANGE]] if force.any() else [],
            "joints": q.round(4).tolist(),
            "numbers": [round(each, 4) for each in numbers],
        }


class _AmongMoving(Following):
    """The tracker is told where bodies are, which go on in every tick, enabled or not."""

    def __init__(self, tracker: PoseTracker, section: ClearanceSection, *followed: Any) -> None:
        super().__init__(tracker, *followed, then="again")
        self._among, self._section, self._ticks, self._told = tracker, section, 0, section.moving_at(0.0)[0]

    def track(self, seen: Measurement, twist: Array, *, enable: bool) -> Command:
        self._told = self._section.moving_at(self.plant.dt * self._ticks)[0]
        self._ticks += 1
        return self._among.step(
            seen.position, self.target, twist, obstacles=self._told, enable=enable, stamp=self.stamp(seen)
        )

    def shown(self) -> dict[str, ArrayLike]:
        return super().shown() | {"bodies": self._told.ravel()}


STILL = 1e-3
"""[m/s, rad/s] A reference slower than this stands still: a solver may leave micrometres a second undelivered."""


@dataclass(frozen=True, eq=False)
class RobotOutcome(MovementOutcome):
    """A pose followed by a robot, N ticks.

    Parameters
    ----------
    reference, tool : (N, 3) positions [m].
    position_error, orientation_error : (N,) [m, rad].
    q, command : (N, n) true positions [rad], commanded velocities [rad/s].
    status : (N,) of each command.
    motion : of the joints, commanded and true; None where they are the same.
    near : how near bodies came to each other; None without `[clearance]`.
    """

    reference: Array = field(kw_only=True)
    tool: Array = field(kw_only=True)
    position_error: Array = field(kw_only=True)
    orientation_error: Array = field(kw_only=True)
    q: Array = field(kw_only=True)
    command: Array = field(kw_only=True)
    status: tuple[str, ...] = field(kw_only=True)
    motion: JointMotion | None = field(kw_only=True, default=None)
    near: NearestBodies | None = field(kw_only=True, default=None)

    def trace(self) -> Iterator[Column]:
        """One row a tick."""
        yield "t_s", self.time
        yield from point_columns("reference", self.reference)
        yield from point_columns("tool", self.tool)
        yield "position_error_m", self.position_error
        yield "orientation_error_rad", self.orientation_error
        yield "status", self.status
        yield from joint_columns("joint", self.chain, self.q, "rad")
        yield from joint_columns("command", self.chain, self.command, "rad_s")
        if self.motion is not None:
            yield from joint_columns("measured", self.chain, self.motion.measured, "rad")
            yield from joint_columns("velocity", self.chain, self.motion.velocity, "rad_s")


BEHIND, TURNED = 5e-3, math.radians(3.0)
"""[m, rad] A tool farther from its path, or turned so much from it, did not follow it."""
AT_LIMIT, AT_SPEED, SINGULAR = math.radians(0.5), 0.98, 0.03
"""[rad] From its limit, of a joint that is there; share of the largest speed; least singular value of the Jacobian."""
OFTEN, LOOKED_AT = 0.1, 200
"""Share of the time behind in which a cause is one; ticks of it whose postures are looked at."""


def _left_behind(
    robot: SerialChain, *, times: Array, q: Array, velocity: Array, tool: Array, error: Array, turned: Array,
    most: float, bodies: bool,
) -> tuple[str, ...]:  # fmt: skip
    """A note on a tool (N, 4, 4) that was off its path by error and turn (N,), and on what kept it; or none.

    `most` is the tool's largest speed; `bodies` says whether the robot keeps clear of some.
    """
    behind = np.flatnonzero(~((error <= BEHIND) & (turned <= TURNED)))
    if not behind.size:
        return ()
    at_limit = np.minimum(q - robot.lower, robot.upper - q)[behind] < AT_LIMIT
    fast = (np.abs(velocity) / robot.velocity)[behind] > AT_SPEED
    free = int(np.count_nonzero(~robot.locked))
    speed = np.linalg.norm(np.gradient(tool[:, :3, 3], times, axis=0), axis=1)[behind]
    some = behind[:: math.ceil(behind.size / LOOKED_AT)]
    values = np.array([np.linalg.svd(robot.jacobian(each), compute_uv=False) for each in q[some]])
    fractions = {
        f"{name} {what}": fraction
        for what, ticks in (("at its limit", at_limit), ("as fast as it may", fast))
        for name, fraction in zip(robot.names, ticks.mean(axis=0), strict=True)
    }
    hard = np.abs(np.asarray(np.gradient(velocity, times, axis=0))) / robot.acceleration > AT_SPEED
    fractions["the joints accelerate as they may"] = hard.any(axis=1)[behind].mean()
    fractions[f"the tool at its {most:g} m/s"] = np.mean(speed > AT_SPEED * most)
    fractions["the posture nearly singular"] = np.mean(values[:, min(free, 6) - 1] < SINGULAR)
    causes = [f"{cause} ({fraction:.0%})" for cause, fraction in fractions.items() if fraction >= OFTEN]
    if free < 6:
        causes.append(f"an arm of {free} joints, which cannot hold every orientation")
    otherwise = "no joint was at a limit of its own, nor the posture singular" + ": is the way free?" * bodies
    k = int(np.argmax(np.maximum(error / BEHIND, turned / TURNED)))
    return (
        NotMet(
            f"NOT FOLLOWED: for {behind.size / error.size:.0%} of the time the tool was more than {1e3 * BEHIND:g} mm "
            f"or {math.degrees(TURNED):g} deg from its path, at most {1e3 * error.max():.3g} mm and "
            f"{math.degrees(turned.max()):.3g} deg, after {times[k]:.2f} s; meanwhile "
            + (", ".join(causes) or otherwise)
        ),
    )


CHECKED_HZ = 50.0
"""At most, of the run that `check` reports."""


class PoseTrackingSystem(System[PoseTracking, RobotOutcome]):
    """A simulated robot that follows a circle, or a path of a file, with `PoseTracker`."""

    schema = PoseTracking
    shown = ("rehab_opt.session.pose_tracking.shown",)
    options = frozenset({"plant", "solver"})
    solver_key = "tracker.solver"
    rate_key = "tracker.rate_hz"

    def recordings(self, problem: PoseTracking) -> tuple[Needed, ...]:
        """The path's file, where it is no circle; the robot file."""
        path = () if problem.path is None else (Needed("path.file", problem.path.file),)
        return (*path, *robot_files(problem.robot))

    def check(self, config: ProblemFile[PoseTracking]) -> tuple[str, ...]:
        """Builds robot and tracker; what `run` would note where joints move as commanded, at `CHECKED_HZ`."""
        live, problem = LivePoseTracking(config, solver=None), config.problem
        tracker_of(problem, live.robot, file=config.file)
        _ = live.recording  # refused where the file's own rate makes it too long
        tracker = problem.tracker.model_copy(update={"rate_hz": min(problem.tracker.rate_hz, CHECKED_HZ)})
        quick = problem.model_copy(update={"tracker": tracker, "plant": JointPlant()})
        _, *notes = self.run(replace(config, problem=quick), options={}, progress=lambda *_: None).notes
        return tuple(notes)

    def run(self, config: ProblemFile[PoseTracking], *, options: Mapping[str, str], progress: Progress) -> RobotOutcome:
        """Options: `solver` of the tracker, `plant`."""
        solver = options.get("solver")
        problem, live = config.problem, LivePoseTracking(config, solver=solver)
        robot, rate, (poses, twists) = live.robot, problem.tracker.rate_hz, live.reference
        ran = simulate(
            live.control(), lambda _: LiveInputs(enable=True), ticks=len(poses),
            progress=partial(progress, "following the path"),
        )  # fmt: skip
        times, command, scales = live.dt * np.arange(len(poses), dtype=np.float64), ran.values, ran.scales
        tool = np.array([robot.pose(q) for q in ran.q])
        position_error = np.linalg.norm(tool[:, :3, 3] - poses[:, :3, 3], axis=1)
        orientation_error = turn_angles(tool[:, :3, :3], poses[:, :3, :3])
        acceleration = np.abs(np.diff(command, axis=0, prepend=np.zeros((1, robot.n)))) * rate
        near = nearest_bodies(problem.clearance, config.file, robot, ran.q, times)
        moving = np.maximum(np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)) >= STILL
        behind = _left_behind(
            robot, times=times, q=ran.q, velocity=command, tool=tool, error=position_error, turned=orientation_error,
            most=problem.tracker.linear_speed_m_s, bodies=problem.clearance is not None,
        )  # fmt: skip
        own = inspect.signature(PoseTracker).parameters
        metrics: dict[str, Any] = {
            "parameters": {
                "controller": "PoseTracker",
                "solver": solver or problem.tracker.solver or own["solver"].default,
                "backup": own["backup"].default,
                "gain_per_s": own["gain"].default if problem.tracker.gain_per_s is None else problem.tracker.gain_per_s,
                "joint_speed_deg_s": np.rad2deg(robot.velocity).tolist(),
                "joint_acceleration_deg_s2": np.rad2deg(robot.acceleration).tolist(),
            },
            "ticks": len(times),
            "duration_s": float(times[-1]),
            **error_metrics(position_error, "position_error", "m"),
            **error_metrics(np.rad2deg(orientation_error), "orientation_error", "deg"),
            **joint_metrics(robot, ran.q, rate),
            "joint_acceleration_max_fraction_of_limit": float((acceleration / robot.acceleration).max()),
            **time_metrics(ran.seconds, "tick"),
            "tick_p99_9_ms": float(1e3 * np.percentile(ran.seconds, 99.9)),
            "scale_min": float(scales.min()),
            "scale_min_moving": float(scales[moving].min()) if moving.any() else None,
            "status": status_counts(ran.status),
            "relaxed": status_counts(text for text in ran.relaxed if text),
            **({} if near is None else {"clearance": near.metrics}),
        }
        return RobotOutcome(
            chain=robot,
            time=times,
            notes=(
                plant_note(problem.plant, "the robot is simulated: its joints move exactly as commanded"),
                *(() if live.recording is None else live.recording.notes),
                *robot.notes,
                *behind,
                *(() if near is None else (near.note,)),
            ),
            metrics={
                "optimised": metrics,
            },
            reference=poses[:, :3, 3],
            tool=tool[:, :3, 3],
            position_error=position_error,
            orientation_error=orientation_error,
            q=ran.q,
            command=command,
            status=ran.status,
            motion=ran.motion,
            near=near,
        )

    def live(self, config: ProblemFile[PoseTracking], *, options: Mapping[str, str]) -> LiveProblem:
        """The path, until somebody drags the target; options as of `run`."""
        return LivePoseTracking(config, solver=options.get("solver"))
