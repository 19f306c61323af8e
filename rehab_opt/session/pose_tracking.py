"""`system = "pose_tracking"`: a `PoseTracker` moves a robot's tool along a circle, or along a path from a file."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.control.command import Command
from rehab_opt.control.conditioning import conditioned
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import MOVING
from rehab_opt.kinematics.vr import quaternions_of
from rehab_opt.plants.intention import minimum_jerk
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.clearance import ClearanceSection, NearestBodies, clearance_key, clearance_of, nearest_bodies
from rehab_opt.session.drawing import (
    LAW_STYLES,
    MM,
    Gaps,
    Panel,
    figure_over_time,
    joint_figure,
    path_figure,
    servo_figure,
)
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.live.bodies import BLUE, ArmBodies, kept_off, moving_rows, screen
from rehab_opt.session.live.problem import Following, LiveControl
from rehab_opt.session.outcome import (
    Array,
    Names,
    Outcome,
    error_metrics,
    joint_metrics,
    status_counts,
    time_metrics,
    turn_angles,
)
from rehab_opt.session.plant import JointPlant, device_of, joint_plant, plant_note
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.robot_file import RobotSection, robot_at_start
from rehab_opt.session.scene import Plot, Scene, SceneSystem, arm_plots
from rehab_opt.session.schema import Problem, RecordedSection, Section, SolverName, Triple, refusal
from rehab_opt.session.systems import NotMet
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_TICKS = 2_000_000


class CircleSection(Section):
    """A circular path of the tool through the tool's starting point, from rest to rest."""

    radius_m: float = Field(gt=0, le=1)
    """Radius of the tool's path."""
    normal: Triple = Field(default=[0.0, 0.0, 1.0])
    """Axis of the circle; the first direction of motion is the cross product of `normal` and `towards`."""
    towards: Triple = Field(default=[1.0, 0.0, 0.0])
    """Direction from the starting point to the centre; only the component perpendicular to `normal` counts."""
    turns: float = Field(default=1.0, gt=0, le=100)
    """Number of turns."""
    duration_s: float = Field(gt=0, le=600)
    """Duration of the whole motion, from rest to rest."""
    swing_deg: float = Field(default=0.0, ge=0, le=90)
    """Largest rotation of the tool about the tool's z axis."""

    @model_validator(mode="after")
    def directions_differ(self) -> Self:
        """Refuse parallel directions `normal` and `towards`, which define no plane."""
        if np.sum(np.cross(self.normal, self.towards) ** 2) < 1e-12:
            raise PydanticCustomError("no_plane", "normal and towards neither zero nor parallel")
        return self


class PathSection(RecordedSection):
    """A recorded path of the tool, from rest to rest, with the tool's starting orientation; gaps are bridged."""

    from_start: bool = True
    """If true, the path is shifted so that its first point is the tool's starting position. If false, the points are in
    the robot's base frame, and the tool first moves straight to the first point at 0.1 m/s."""
    cutoff_hz: float = Field(default=8.0, gt=0, le=1000)
    """Cut-off of the low-pass filter (two equal poles) that smooths the path; the filter delays the path."""


class TrackerSection(Section):
    """The tracking controller, `PoseTracker`."""

    rate_hz: float = Field(default=1000.0, ge=10, le=10000)
    """Ticks per second."""
    gain_per_s: float | None = Field(default=None, gt=0, le=10000)
    """Rate at which a pose error decays; default: `PoseTracker`'s."""
    linear_speed_m_s: float = Field(default=1.0, gt=0, le=10)
    """Largest speed of the tool."""
    solver: SolverName | None = None
    """Solver of the QP; default: `PoseTracker`'s own. The option `--solver` overrides this key."""


class PoseTracking(Problem):
    """A robot whose tool follows a moving pose."""

    system: Literal["pose_tracking"]
    robot: RobotSection
    """The robot."""
    circle: CircleSection | None = None
    """The circular path; a problem has either `[circle]` or `[path]`."""
    path: PathSection | None = None
    """The path from a file; a problem has either `[circle]` or `[path]`."""
    tracker: TrackerSection = TrackerSection()
    """The controller."""
    clearance: ClearanceSection | None = None
    """Bodies that the arm avoids."""
    plant: JointPlant = JointPlant()
    """The simulated or real robot."""

    @model_validator(mode="after")
    def one_path_fits_into_memory(self) -> Self:
        """Refuse a run of more than 2 million ticks, and both or neither of `[circle]` and `[path]`."""
        if (self.circle is None) == (self.path is None):
            raise refusal("circle", self.circle, "a table [circle] or a table [path], one of them")
        rate, duration = self.tracker.rate_hz, 0.0 if self.circle is None else self.circle.duration_s
        if rate * duration > MAX_TICKS:
            raise refusal("tracker.rate_hz", rate, f"at most {MAX_TICKS} ticks in circle.duration_s = {duration:g}")
        return self


Config = ProblemFile[PoseTracking]
KEYS = {"gain": "tracker.gain_per_s", "dt": "tracker.rate_hz", "linear_speed": "tracker.linear_speed_m_s"}
"""Keys of the problem file, by argument of `PoseTracker`."""


def tracker_of(
    problem: PoseTracking, robot: SerialChain, *, file: str, solver: str | None = None, backup: str | None = None
) -> PoseTracker:
    """The tracker with the parameters of the problem file; `backup` as for `PoseTracker`.

    Raises
    ------
    ProblemFileError : a value of the problem file is invalid for the tracker.
    ConfigurationError : `solver` is invalid for the tracker.
    """
    keys = problem.tracker.arguments("gain_per_s", "linear_speed_m_s", "solver")
    keys |= {"solver": solver} if solver else {}
    with refused_as(file, lambda name: clearance_key(name) or KEYS.get(name, f"tracker.{name}"), option=solver):
        limits = clearance_of(problem.clearance, file, moving=True)
        return PoseTracker(robot, dt=1 / problem.tracker.rate_hz, limits=limits, backup=backup, **keys)


def circle_reference(start: Array, circle: CircleSection, times: Array) -> tuple[Array, Array]:
    """Poses (N, 4, 4) and twists (N, 6) at `times` (N,) [s] of a circle through the pose `start` (4, 4).

    The phase a rises from 0 to 2 pi `turns` as a minimum-jerk polynomial of time, from rest to rest. The centre is
    `radius_m` away from the start, in the direction of the component of `towards` perpendicular to `normal`. The tool
    rotates about its own z axis by swing (1 - cos a) / 2, so each turn ends with the starting orientation.
    """
    normal, towards = (np.array(each) / np.linalg.norm(each) for each in (circle.normal, circle.towards))
    towards = towards - (normal @ towards) * normal
    towards /= np.linalg.norm(towards)
    u, whole, most = times / circle.duration_s, 2 * math.pi * circle.turns, math.radians(circle.swing_deg)
    phase, rate = whole * minimum_jerk(u), whole * 30 * (u * (1 - u)) ** 2 / circle.duration_s
    cosine, sine, swing = np.cos(phase)[:, None], np.sin(phase)[:, None], most * (1 - np.cos(phase)) / 2
    poses, twists = np.tile(start, (len(u), 1, 1)), np.zeros((len(u), 6))
    poses[:, :3, 3] += circle.radius_m * ((1 - cosine) * towards + sine * np.cross(normal, towards))
    poses[:, :3, 0] = np.outer(np.cos(swing), start[:3, 0]) + np.outer(np.sin(swing), start[:3, 1])
    poses[:, :3, 1] = np.outer(np.cos(swing), start[:3, 1]) - np.outer(np.sin(swing), start[:3, 0])
    twists[:, :3] = circle.radius_m * rate[:, None] * (sine * towards + cosine * np.cross(normal, towards))
    twists[:, 3:] = np.outer(most * np.sin(phase) / 2 * rate, start[:3, 2])
    return poses, twists


STAYS, FASTEST, NOISE, APPROACH, STEP = 1.0, 5.0, 0.02, 0.1, 0.02
"""Pause at a path's end [s]; largest speed between samples [m/s] and tolerance for noise [m]; speed of the approach to
a path's first point [m/s] and its time step [s]."""


def path_reference(config: Config, path: PathSection, start: Array) -> tuple[Array, Array, tuple[str, ...], Gaps]:
    """Four results: poses (N, 4, 4) and twists (N, 6) along the points of a file, notes, and gaps (from, to) [s].

    All poses have the orientation of the pose `start` (4, 4). The times of the gaps count from the first pose.

    Raises
    ------
    ProblemFileError : the file is missing, unreadable or too long, or its points jump or are too few.
    """
    file, rate = config.file, config.problem.tracker.rate_hz
    try:
        recording = read_recording(recording_path(config, path.file, key="path.file"), name=path.file, **path.reading())
    except ProblemFileError as refused:
        if not refused.key.startswith("recording."):
            raise  # the error is about a line or column of the recording
        key, expected = refused.key.replace("recording", "path", 1), refused.expected.replace("recording.", "path.")
        raise ProblemFileError(file, key, refused.value, expected) from refused
    if recording.points.shape[1] < 2:
        raise ProblemFileError(file, "path.columns", path.columns, "the columns that hold x, y (and z)")
    if recording.duration * rate > MAX_TICKS:
        expected = f"at most {MAX_TICKS} ticks in the path's {recording.duration:g} s"
        raise ProblemFileError(file, "tracker.rate_hz", rate, expected)
    points = np.pad(recording.points, ((0, 1), (0, 3 - recording.points.shape[1])))
    points[-1], time = points[-2], np.append(recording.time, recording.time[-1] + STAYS)
    if path.from_start:
        points += start[:3, 3] - points[0]
    else:
        way = points[0] - start[:3, 3]
        u = np.linspace(0.0, 1.0, 2 + math.ceil(1.875 * float(np.linalg.norm(way)) / (APPROACH * STEP)))
        points = np.concatenate([start[:3, 3] + minimum_jerk(u)[:-1, None] * way, points])
        time = np.concatenate([time[0] + STEP * np.arange(1 - len(u), 0), time])
    jumps = np.linalg.norm(np.diff(points, axis=0), axis=1) > FASTEST * np.diff(time) + NOISE
    if jumps.any():
        value = f"a jump at {time[jumps.argmax()]:.6g} s"
        raise ProblemFileError(path.file, "points", value, f"a path without, at most {FASTEST:g} m/s fast")
    turn, gap = np.tile(quaternions_of(start[None, :3, :3]), (len(time), 1)), float(np.ptp(time)) + 1
    with refused_as(path.file):
        found = conditioned(time, points, turn, dt=1 / rate, cutoff_hz=path.cutoff_hz, max_gap=gap, max_speed=1e6)
    return found.poses, found.twists, recording.notes, tuple((a - time[0], b - time[0]) for a, b in recording.gaps)


class _AmongMoving(Following):
    """Control that passes the positions of moving bodies to the tracker; the bodies move in every tick."""

    def __init__(self, tracker: PoseTracker, section: ClearanceSection, *followed: Any) -> None:
        super().__init__(tracker, *followed, then="again")
        self._among, self._section, self._ticks, self._told = tracker, section, 0, section.moving_at(0.0)[0]

    def track(self, seen: Measurement, twist: Array, *, enable: bool) -> Command:
        self._told = self._section.moving_at(self.plant.dt * self._ticks)[0]
        self._ticks += 1
        around = {"obstacles": self._told, "stamp": self.stamp(seen)}
        return self._among.step(seen.position, self.target, twist, enable=enable, **around)

    def shown(self) -> dict[str, ArrayLike]:
        return super().shown() | {"bodies": self._told.ravel()}


STILL = 1e-3
"""Speed [m/s, rad/s] below which the reference counts as at rest."""
BEHIND, TURNED = 5e-3, math.radians(3.0)
"""Errors in position [m] and orientation [rad] above which the tool counts as off its path."""
AT_LIMIT, AT_SPEED, SINGULAR = math.radians(0.5), 0.98, 0.03
"""Thresholds for the cause of an error: distance to a joint limit [rad], fraction of a largest speed or acceleration,
smallest singular value of the Jacobian."""
OFTEN, LOOKED_AT = 0.1, 200
"""Fraction of the time off the path above which a note names a cause; largest number of postures that are examined."""


class PoseTrackingScene(Scene):
    """The scene of a `PoseTracking` problem: a `PoseTracker` with robot and plant, among bodies that may move."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, config: Config, solver: str | None) -> None:
        problem = self.problem = config.problem
        self._file, self._solver, self.title, self.device = config.file, solver, problem.title, device_of(problem.plant)
        self.chain, self.start = robot_at_start(config)
        self.dt, self.names = 1 / problem.tracker.rate_hz, tuple(self.chain.names)
        self.said: tuple[str, ...] = ()
        self.gaps: Gaps = ()
        pose = self.chain.pose(self.start)
        if problem.circle is not None:
            times = self.dt * np.arange(round(problem.circle.duration_s / self.dt) + 1, dtype=np.float64)
            self.poses, self.twists = circle_reference(pose, problem.circle, times)
        elif problem.path is not None:
            self.poses, self.twists, self.said, self.gaps = path_reference(config, problem.path, pose)
        self.ticks, around, self.bodies = len(self.poses), problem.clearance, ArmBodies(self.chain)
        self._moving = around if around is not None and around.moving else None
        self.layout = {"q": self.chain.n, "target": 3, "force": 3}
        self.layout |= {"bodies": self._moving.moving_at(0.0).size} if self._moving is not None else {}

        def off(of: Mapping[str, Any]) -> float:
            return MM * float(np.linalg.norm(of["hand"] - of["target"]))

        self.plots = (Plot("position error", "mm", off, {"least": 1.0}), *arm_plots(self.chain))
        path = self.poses[:: max(1, round(0.05 / self.dt)), :3, 3]
        still = kept_off(path.mean(axis=0), clearance_of(around, self._file, moving=True))
        lines = [{"points": path.round(4).tolist(), "colour": BLUE, "name": "reference"}, *still["lines"]]
        centre = (0.5 * self.bodies.tool(self.start)[:, 3]).round(3).tolist()
        self.still = {**still, "lines": lines, "screen": screen(path), "centre": centre, "reach": 1.2}

    def control(self, plant: Plant | None = None) -> LiveControl:
        """The tracker on `plant`, by default on the plant of the problem file."""
        tracker = tracker_of(self.problem, self.chain, file=self._file, solver=self._solver)
        plant = TouchedPlant(joint_plant(self.problem.plant, self.chain, self.dt)) if plant is None else plant
        followed = plant, self.start, self.poses, self.twists
        if self._moving is None:
            return Following(tracker, *followed, then="again")
        return _AmongMoving(tracker, self._moving, *followed)

    def derived(self, trace: Trace) -> None:
        """Add columns with the tool's position and with its errors in position and orientation."""
        tool = np.array([self.chain.pose(q) for q in trace["joint"]])
        trace |= {"reference": self.poses[:, :3, 3], "tool": tool[:, :3, 3]}
        trace["position_error_m"] = np.linalg.norm(trace["tool"] - trace["reference"], axis=1)
        trace["orientation_error_rad"] = turn_angles(tool[:, :3, :3], self.poses[:, :3, :3])
        for unit, columns in (("rad", ("joint", "measured")), ("rad_s", ("command", "velocity"))):
            trace.parts |= {column: [f"{name}_{unit}" for name in self.names] for column in columns}

    def near(self, trace: Trace) -> NearestBodies | None:
        """Distances between the arm and the bodies of `[clearance]`; None without this table."""
        return nearest_bodies(self.problem.clearance, self._file, self.chain, trace["joint"], trace["t_s"])

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Data of the page's frame, including the moving bodies."""
        frame, moving = super().frame(shown), shown.get("bodies", np.zeros(0)).reshape(-1, MOVING)
        return frame | {"capsules": frame["capsules"] + moving_rows(moving)}

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics: errors, joint-limit margins, speeds and computing times."""
        chain, table, near = self.chain, self.problem.tracker, self.near(trace)
        own = inspect.signature(PoseTracker).parameters
        hard = np.abs(np.diff(trace["command"], axis=0, prepend=0.0)) / self.dt / chain.acceleration
        moves = [np.linalg.norm(self.twists[:, part], axis=1) >= STILL for part in (slice(3), slice(3, 6))]
        moving = moves[0] | moves[1]
        return {
            "parameters": {
                "controller": "PoseTracker",
                "solver": self._solver or table.solver or own["solver"].default,
                "backup": own["backup"].default,
                "gain_per_s": own["gain"].default if table.gain_per_s is None else table.gain_per_s,
                "joint_speed_deg_s": np.rad2deg(chain.velocity).tolist(),
                "joint_acceleration_deg_s2": np.rad2deg(chain.acceleration).tolist(),
            },
            "ticks": len(trace["t_s"]),
            "duration_s": float(trace["t_s"][-1]),
            **error_metrics(trace["position_error_m"], "position_error", "m"),
            **error_metrics(np.rad2deg(trace["orientation_error_rad"]), "orientation_error", "deg"),
            **joint_metrics(chain, trace["joint"], 1 / self.dt),
            "joint_acceleration_max_fraction_of_limit": float(hard.max()),
            **time_metrics(trace["_seconds"], "tick"),
            "tick_p99_9_ms": float(1e3 * np.percentile(trace["_seconds"], 99.9)),
            "scale_min": float(trace["scale"].min()),
            "scale_min_moving": float(trace["scale"][moving].min()) if moving.any() else None,
            "status": status_counts(trace["status"].tolist()),
            "relaxed": status_counts(filter(None, trace["relaxed"].tolist())),
            **({} if near is None else {"clearance": near.metrics}),
        }

    def notes(self, trace: Trace) -> Iterator[str]:
        """Notes on the plant, the files, the times and causes of deviations from the path, and the nearest bodies."""
        yield plant_note(self.problem.plant, "the robot is simulated: its joints move exactly as commanded")
        yield from (*self.said, *self.chain.notes)
        behind = ~((trace["position_error_m"] <= BEHIND) & (trace["orientation_error_rad"] <= TURNED))
        if behind.any():
            yield self._left_behind(trace, behind)
        near = self.near(trace)
        if near is not None:
            yield near.note

    def _left_behind(self, trace: Trace, behind: Any) -> NotMet:
        """Note on the ticks `behind` (N,) with the tool off its path: fraction of time, largest errors, causes."""
        chain, q, velocity, tool = self.chain, trace["joint"], trace["command"], trace["tool"]
        error, turned = trace["position_error_m"], trace["orientation_error_rad"]
        most = self.problem.tracker.linear_speed_m_s
        free, rate, ticks = int(np.count_nonzero(~chain.locked)), 1 / self.dt, np.flatnonzero(behind)
        at_limit = np.minimum(q - chain.lower, chain.upper - q)[ticks] < AT_LIMIT
        fast = (np.abs(velocity) / chain.velocity)[ticks] > AT_SPEED
        hard = np.abs(np.asarray(np.gradient(velocity, axis=0))) * rate / chain.acceleration > AT_SPEED
        speed = np.linalg.norm(np.gradient(tool, axis=0), axis=1) * rate
        some = ticks[:: math.ceil(ticks.size / LOOKED_AT)]
        values = np.array([np.linalg.svd(chain.jacobian(each), compute_uv=False) for each in q[some]])
        fractions = dict(zip((f"{name} at its limit" for name in self.names), at_limit.mean(axis=0), strict=True))
        fractions |= zip((f"{name} at its largest speed" for name in self.names), fast.mean(axis=0), strict=True)
        fractions["the joints at their largest acceleration"] = hard.any(axis=1)[ticks].mean()
        fractions[f"the tool at its {most:g} m/s"] = np.mean(speed[ticks] > AT_SPEED * most)
        fractions["the posture nearly singular"] = np.mean(values[:, min(free, 6) - 1] < SINGULAR)
        causes = [f"{cause} ({fraction:.0%})" for cause, fraction in fractions.items() if fraction >= OFTEN]
        causes += [f"an arm of {free} joints, which cannot hold every orientation"] if free < 6 else []
        bodies = "; do the bodies block the path?" if self.problem.clearance is not None else ""
        otherwise = f"no joint was at a limit, and the posture was not singular{bodies}"
        k = int(np.argmax(np.maximum(error / BEHIND, turned / TURNED)))
        return NotMet(
            f"NOT FOLLOWED: for {behind.mean():.0%} of the time the tool was more than {MM * BEHIND:g} mm or "
            f"{math.degrees(TURNED):g} deg from its path, at most {MM * error.max():.3g} mm and "
            f"{math.degrees(turned.max()):.3g} deg, after {trace['t_s'][k]:.2f} s; meanwhile "
            + (", ".join(causes) or otherwise)
        )


CHECKED_HZ = 50.0
"""Largest rate [Hz] of the run that `check` makes."""


class PoseTrackingSystem(SceneSystem[PoseTracking, PoseTrackingScene]):
    """System in which a robot's tool follows a circle, or a path from a file."""

    schema = PoseTracking
    solver_key, rate_key = "tracker.solver", "tracker.rate_hz"
    first = ("position_error", "orientation_error", "joint_limit_margin", "scale", "status")

    def check(self, config: Config) -> tuple[str, ...]:
        """Build robot and tracker; return the notes of a run with ideal joints at a rate of at most 50 Hz."""
        problem, scene = config.problem, PoseTrackingScene(config, None)  # checks the number of ticks at the full rate
        tracker_of(problem, scene.chain, file=config.file)
        tracker = problem.tracker.model_copy(update={"rate_hz": min(problem.tracker.rate_hz, CHECKED_HZ)})
        quick = problem.model_copy(update={"tracker": tracker, "plant": JointPlant()})
        _, *notes = self.run(replace(config, problem=quick), options={}, progress=lambda *_: None).notes
        return tuple(notes)

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, PoseTrackingScene]:
        """One scene, the run along the path."""
        return {("optimised",): PoseTrackingScene(config, options.get("solver"))}

    def figures(self, outcome: Outcome) -> dict[str, Figure]:
        """Figures of the path, the joints and the errors, and of servos and distances to bodies if there are any."""
        (scene,), (trace,) = outcome.scenes.values(), outcome.traces.values()
        fastest = scene.chain.velocity
        joints = [(trace["t_s"], trace["joint"], LAW_STYLES["optimised"])]
        panels = (
            Panel("position error [mm]", lambda of: MM * of["position_error_m"]),
            Panel("orientation error [deg]", lambda of: np.rad2deg(of["orientation_error_rad"])),
            Panel("fastest joint [% of limit]", lambda of: 100 * (abs(of["command"]) / fastest).max(axis=1), 100),
        )
        errors = "Tracking errors of the tool, and the fastest joint's speed as a fraction of its limit, over time."
        found = {
            "tool_path": path_figure(trace["reference"], {"optimised": trace["tool"]}),
            "joints": joint_figure(scene.chain, joints),
            "error": figure_over_time(errors, {"": {"optimised": trace}}, panels, gaps=scene.gaps),
        }
        if "velocity" in trace:
            found["servos"] = servo_figure(scene.names, trace, fastest)
        near = scene.near(trace)
        return found if near is None else found | {"clearance": near.figure()}
