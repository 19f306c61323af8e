"""`system = "mirror"`: the recording in the robot's frame, a run with each controller, and the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rehab_opt.control.conditioning import Conditioner
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.published.astar import AStarPath
from rehab_opt.session.clearance import NearestBodies, nearest_bodies, start_notes
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.mirror.laws import ANY_SPEED, planned, searched, track_reference, tracker_of, without_floor
from rehab_opt.session.mirror.live import LiveMirror
from rehab_opt.session.mirror.metrics import astar_metrics, causes, driven, led_metrics
from rehab_opt.session.mirror.outcome import BEFORE, LAWS, STEP, MirrorRuns, led_trace
from rehab_opt.session.mirror.placing import reach_note
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import Setup, laid_out, path_notes
from rehab_opt.session.outcome import Outcome, Progress
from rehab_opt.session.plant import joint_plant, plant_note
from rehab_opt.session.systems import Names, System
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["MirrorSystem", "runs_of"]

Config = ProblemFile[MirrorProblem]


class Mirrored:
    """The parts that all runs of a file share.

    Raises
    ------
    ProblemFileError : a recording or a value of the file is not valid.
    """

    def __init__(self, config: Config) -> None:
        self.problem, self.file, self.setup = config.problem, config.file, laid_out(config)
        self.dt = 1.0 / self.problem.tracker.rate_hz
        self.tracker = tracker_of(self.problem, self.setup, file=config.file)
        self.bounds, self.plant = self.tracker.hand_bounds, joint_plant(self.problem.plant, self.setup.robot, self.dt)
        reference = self.setup.reference
        self.seen = reference.poses[~reference.lost]
        self.progress: Progress = lambda *_: None

    @cached_property
    def astar(self) -> AStarPath | None:
        """The published path, if requested."""
        most = self.tracker.max_manipulability
        return searched(self.problem, self.setup, max_manipulability=most, progress=self.progress)


class LedScene:
    """The hand led along the reference by one of `LAWS`."""

    def __init__(self, task: Mirrored, name: str) -> None:
        self.task, self.name = task, name

    def run(self, progress: Progress = lambda *_: None) -> Trace:
        """See `led_trace`."""
        task = self.task
        section, setup, most = task.problem.tracker, task.setup, task.tracker.max_manipulability
        plant, speed = task.plant, section.linear_speed_m_s
        if self.name == BEFORE:
            led, speed = without_floor(setup, plant, max_manipulability=most, progress=progress), ANY_SPEED
        elif self.name == STEP:
            led = track_reference(task.tracker, setup, plant, patience=section.patience, progress=progress)
        else:
            led = planned(task.tracker, setup, progress=progress)
            task.progress = progress
            _ = task.astar
        drive = driven(led, setup.robot, task.problem.smoothing, linear_speed=speed, max_manipulability=most)
        return led_trace(led, drive, causes(led, drive, task.bounds), setup.robot.names)

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """See `led_metrics`."""
        led, drive, task = trace["_led"].item(), trace["_drive"].item(), self.task
        return led_metrics(led, drive, task.bounds, task.seen, cause=trace["_cause"], rate=1.0 / task.dt)

    def notes(self, trace: Trace) -> Iterator[str]:
        """No notes here: see `MirrorSystem.notes`."""
        return iter(())


def _task(outcome: Outcome) -> Mirrored:
    task: Mirrored = next(iter(outcome.scenes.values())).task
    return task


def _near(outcome: Outcome) -> NearestBodies | None:
    """Distances between bodies, tick by tick."""
    task, trace = _task(outcome), outcome.traces[STEP,]
    return nearest_bodies(task.problem.clearance, task.file, task.setup.robot, trace["joint"], trace["t_s"])


def runs_of(outcome: Outcome) -> MirrorRuns:
    """Data for the figures of a run."""
    task = _task(outcome)
    setup, traces = task.setup, {name: trace for (name,), trace in outcome.traces.items()}
    return MirrorRuns(
        metrics=outcome.metrics,
        chain=setup.robot,
        time=setup.reference.times - setup.reference.times[0],
        mirror=setup.mirror,
        reference=setup.reference.poses,
        recorded=setup.recorded,
        laws={name: trace["_led"].item() for name, trace in traces.items()},
        drives={name: trace["_drive"].item() for name, trace in traces.items()},
        causes={name: trace["_cause"] for name, trace in traces.items()},
        astar=task.astar,
        near=_near(outcome),
        **task.problem.tracker.arguments("floor", "max_deviation_mm", "linear_speed_m_s"),
    )


FAR = 1e-3
"""[m] Distance from the first reference pose above which a note reports the start."""


def _notes(problem: MirrorProblem, scene: Setup, tracker: MirrorTracker) -> Iterator[str]:
    yield "a reconstruction: the equations of the paper (Xu, Guo, Zhang 2021) are missing in our copy"
    yield plant_note(problem.plant, "the robot is simulated: its joints move exactly as commanded")
    if problem.plant.kind != "ideal":
        yield "the plan was not run on that robot, only the controllers that run tick by tick"
    first = scene.reference.poses[~scene.reference.lost][0]
    away = float(np.linalg.norm(scene.robot.pose(scene.start)[:3, 3] - first[:3, 3]))
    if away > FAR:
        yield f"the robot starts {1e3 * away:.0f} mm from the first pose and moves there first; '{BEFORE}' begins there"
    if scene.person is not None:
        yield "the reference is limited to the led arm's range of motion; distances are to the mirrored one"
    w = scene.robot.manipulability(scene.start) / tracker.max_manipulability
    if w < problem.tracker.floor:
        yield f"the robot starts below the floor, at {w:.3f}"
    for i, plane in enumerate(tracker.hand_bounds.planes):
        height = tracker.hand_bounds.min_heights(scene.start[None], plane).item()
        if height < 0.0:
            yield f"the robot starts {-1e3 * height:.3g} mm inside tracker.keep_out.{i}, and moves no deeper"


class MirrorSystem(System[MirrorProblem, LedScene]):
    """A hand led along the other hand's mirrored path."""

    schema = MirrorProblem

    labels = ("law",)
    first = (
        "drive: passed", "drive: deviation", "drive: duration", "complete", "drive: manipulability", "below_floor",
        "drive: seconds_by_cause", "joint_limit_margin", "status",
    )  # fmt: skip
    options = frozenset({"plant"})
    rate_key = "tracker.rate_hz"

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """One column for each controller; A* is a path without times, which no robot follows."""
        laws, astar = dict(outcome.metrics["laws"]), outcome.metrics["astar"]
        if astar is not None:
            name = f"A*, {outcome.metrics['parameters']['astar']['resolution_mm']:g} mm"
            laws[name] = {"drive": {key: of for key, of in astar.items() if key != "complete"}} | astar
        return laws

    def caption(self, outcome: Outcome) -> str:
        """The floor, and the reference."""
        reference = outcome.metrics["reference"]
        return (
            f"floor {_task(outcome).problem.tracker.floor:g} of the robot's largest manipulability; reference of "
            f"{reference['duration_s']:.1f} s, up to {reference['speed_max_m_s']:.2g} m/s, above the cap "
            f"{100 * reference['faster_than_cap_fraction_of_time']:.0f} % of the time; "
            f"filter lag {1e3 * reference['filter_lag_s']:.0f} ms; passed: within 5 mm and 5 deg"
        )

    def check(self, config: Config) -> tuple[str, ...]:
        """Read and place the recording, build the tracker, and count the poses that the robot reaches."""
        scene = laid_out(config)
        tracker = tracker_of(config.problem, scene, file=config.file)
        within = start_notes(config.problem.clearance, config.file, scene.robot, scene.start)
        return (*scene.notes, *within, *path_notes(scene), reach_note(config.problem, scene, tracker))

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, LedScene]:
        """Each controller on the same reference; the option is `plant`."""
        task = Mirrored(config)
        return {(name,): LedScene(task, name) for name in LAWS}

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """Metrics of the reference, of each controller, of A* and of bodies."""
        task, near = _task(outcome), _near(outcome)
        problem, setup, reference = task.problem, task.setup, task.setup.reference
        fast = np.linalg.norm(reference.twists[~reference.lost, :3], axis=1)
        astar = task.astar
        return {
            "reference": {
                "duration_s": float(reference.times[-1] - reference.times[0]),
                "samples": len(reference.poses),
                "samples_lost": int(reference.lost.sum()),
                "samples_dropped": reference.dropped,
                "gaps": reference.gaps,
                "speed_max_m_s": float(fast.max()),
                "faster_than_cap_fraction_of_time": float(np.mean(fast > problem.tracker.linear_speed_m_s)),
                "filter_lag_s": Conditioner(task.dt, cutoff_hz=problem.conditioning.cutoff_hz).lag,
                "calibration_rms_m": setup.fit.rms if setup.fit is not None else None,
                "scale": problem.placement.scale,
            },
            "manipulability_max": task.tracker.max_manipulability,
            "laws": {name: of for (name,), of in numbers.items()},
            "astar": None if astar is None else astar_metrics(astar, task.bounds, task.seen[:, :3, 3]),
            **({} if near is None else {"clearance": near.metrics}),
        }

    def notes(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> Iterator[str]:
        """Notes on the input, the start, incomplete controllers, and the closest bodies."""
        task, near = _task(outcome), _near(outcome)
        yield from (*task.setup.notes, *path_notes(task.setup), *_notes(task.problem, task.setup, task.tracker))
        for (name,), of in numbers.items():
            if not of["complete"]:
                yield f"{name}: INCOMPLETE, the reference's end was not reached within tracker.patience"
        yield from () if near is None else (near.note,)

    def figures(self, outcome: Outcome) -> dict[str, Figure]:
        """See `mirror.shown`."""
        from rehab_opt.session.mirror.shown import figures  # noqa: PLC0415  (draws)

        return figures(runs_of(outcome))

    def live(self, config: Config, *, options: Mapping[str, str]) -> LiveProblem:
        """The mirrored recording to and fro, until the live user drags the hand; the option is `plant`."""
        return LiveMirror(config)
