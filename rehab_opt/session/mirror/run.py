"""`system = "mirror"`: the recording in the robot's frame, a run with each controller, and the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from rehab_opt.control.conditioning import Conditioner
from rehab_opt.published.astar import AStarPath, astar_path
from rehab_opt.session.clearance import NearestBodies, nearest_bodies, start_notes
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.mirror.laws import (
    ANY_SPEED,
    BEFORE,
    LAWS,
    STEP,
    planned,
    track_reference,
    tracker_of,
    without_floor,
)
from rehab_opt.session.mirror.live import LiveMirror
from rehab_opt.session.mirror.metrics import astar_metrics, causes, driven, led_metrics
from rehab_opt.session.mirror.placing import reach_note
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import laid_out, path_notes
from rehab_opt.session.outcome import Names, Outcome, Progress
from rehab_opt.session.plant import joint_plant, plant_note
from rehab_opt.session.systems import System
from rehab_opt.session.trace import Trace

Config = ProblemFile[MirrorProblem]
FAR = 1e-3
"""[m] A note reports the start if it is farther than this from the first reference pose."""


class Mirrored:
    """Problem, robot, tracker and plant, which all runs of a file share."""

    progress: Progress = staticmethod(lambda *_: None)

    def __init__(self, config: Config) -> None:
        self.problem, self.file, self.setup = config.problem, config.file, laid_out(config)
        self.robot, self.dt = self.setup.robot, 1.0 / self.problem.tracker.rate_hz
        self.tracker = tracker_of(self.problem, self.setup, file=config.file)
        self.bounds, self.plant = self.tracker.hand_bounds, joint_plant(self.problem.plant, self.robot, self.dt)
        reference = self.setup.reference
        self.seen = reference.poses[~reference.lost]

    @cached_property
    def astar(self) -> AStarPath | None:
        """Path of the published search, from the first posture that reaches the reference; None without `[astar]`."""
        section = self.problem.astar
        if section is None:
            return None
        self.progress("A*", 0, 1)
        found = astar_path(
            self.robot,
            self.seen,
            self.setup.start,
            floor=self.problem.tracker.floor,
            max_manipulability=self.tracker.max_manipulability,
            **section.arguments(),
        )
        self.progress("A*", 1, 1)
        return found

    def near(self, trace: Trace) -> NearestBodies | None:
        """Distances between bodies, tick by tick; None without `[clearance]`."""
        return nearest_bodies(self.problem.clearance, self.file, self.robot, trace["joint"], trace["t_s"])

    def notes(self) -> Iterator[str]:
        """Notes on the input and the start."""
        problem, setup, bounds = self.problem, self.setup, self.bounds
        yield from (*setup.notes, *path_notes(setup))
        yield "a reconstruction: the equations of the paper (Xu, Guo, Zhang 2021) are missing in our copy"
        yield plant_note(problem.plant, "the robot is simulated: its joints move exactly as commanded")
        if problem.plant.kind != "ideal":
            yield "the plan was not run on that robot, only the controllers that run tick by tick"
        away = 1e3 * float(np.linalg.norm(self.robot.pose(setup.start)[:3, 3] - self.seen[0, :3, 3]))
        if away > 1e3 * FAR:
            yield f"the robot starts {away:.0f} mm from the first pose and moves there first; '{BEFORE}' begins there"
        if setup.person is not None:
            yield "the reference is limited to the led arm's range of motion; distances are to the mirrored one"
        w = self.robot.manipulability(setup.start) / bounds.max_manipulability
        if w < bounds.floor:
            yield f"the robot starts below the floor, at {w:.3f}"
        for i, plane in enumerate(bounds.planes):
            height = bounds.min_heights(setup.start[None], plane).item()
            if height < 0.0:
                yield f"the robot starts {-1e3 * height:.3g} mm inside tracker.keep_out.{i}, and moves no deeper"


class LedScene:
    """Scene in which one of the controllers `LAWS` leads the hand along the reference."""

    def __init__(self, task: Mirrored, name: str) -> None:
        self.task, self.name = task, name

    def run(self, progress: Progress = lambda *_: None) -> Trace:
        """Trace of `led_trace`, with the drive's trace in the column `_drive` and its `causes` in `_cause`."""
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
        drive = driven(led, task.robot, task.problem.smoothing, linear_speed=speed, max_manipulability=most)
        led["_drive"], led["_cause"] = np.asarray(drive), causes(led, drive, task.bounds)
        return led

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics, see `led_metrics`."""
        task, drive = self.task, trace["_drive"].item()
        return led_metrics(trace, drive, task.bounds, task.seen, cause=trace["_cause"], rate=1.0 / task.dt)

    def notes(self, trace: Trace) -> Iterator[str]:
        """A note if the run is incomplete."""
        if not trace["_complete"]:
            yield f"{self.name}: INCOMPLETE, the reference's end was not reached within tracker.patience"


def task_of(outcome: Outcome) -> Mirrored:
    """The mirrored task, which is the same in all scenes of a run."""
    task: Mirrored = next(iter(outcome.scenes.values())).task
    return task


class MirrorSystem(System[MirrorProblem, LedScene]):
    """A hand led along the other hand's mirrored path."""

    schema = MirrorProblem
    drawing = "rehab_opt.session.mirror.shown"
    labels = ("law",)
    first = (
        "drive: passed", "drive: deviation", "drive: duration", "complete", "drive: manipulability", "below_floor",
        "drive: seconds_by_cause", "joint_limit_margin", "status",
    )  # fmt: skip
    options = frozenset({"plant"})
    rate_key = "tracker.rate_hz"

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """One column for each controller, and one for the A* path."""
        laws, astar = dict(outcome.metrics["laws"]), outcome.metrics["astar"]
        if astar is not None:
            name = f"A*, {outcome.metrics['parameters']['astar']['resolution_mm']:g} mm"
            laws[name] = {"drive": {key: of for key, of in astar.items() if key != "complete"}} | astar
        return laws

    def caption(self, outcome: Outcome) -> str:
        """Text below the table: the manipulability floor, and the reference's duration and speed."""
        reference = outcome.metrics["reference"]
        return (
            f"floor {task_of(outcome).problem.tracker.floor:g} of the robot's largest manipulability; reference of "
            f"{reference['duration_s']:.1f} s, up to {reference['speed_max_m_s']:.2g} m/s, above the cap "
            f"{100 * reference['faster_than_cap_fraction_of_time']:.0f} % of the time; "
            f"filter lag {1e3 * reference['filter_lag_s']:.0f} ms; passed: within 5 mm and 5 deg"
        )

    def check(self, config: Config) -> tuple[str, ...]:
        """Read and place the recording, build the tracker, and count the poses that the robot reaches."""
        setup = laid_out(config)
        tracker = tracker_of(config.problem, setup, file=config.file)
        within = start_notes(config.problem.clearance, config.file, setup.robot, setup.start)
        return (*setup.notes, *within, *path_notes(setup), reach_note(config.problem, setup, tracker))

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, LedScene]:
        """Each controller on the same reference; the option is `plant`."""
        task = Mirrored(config)
        return {(name,): LedScene(task, name) for name in LAWS}

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """Metrics as nested dictionaries: the reference, each controller, A*, and the clearance from bodies."""
        task = task_of(outcome)
        near, astar = task.near(outcome.traces[STEP,]), task.astar
        problem, reference = task.problem, task.setup.reference
        fast = np.linalg.norm(reference.twists[~reference.lost, :3], axis=1)
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
                "calibration_rms_m": task.setup.fit.rms if task.setup.fit is not None else None,
                "scale": problem.placement.scale,
            },
            "manipulability_max": task.tracker.max_manipulability,
            "laws": {name: of for (name,), of in numbers.items()},
            "astar": None if astar is None else astar_metrics(astar, task.bounds, task.seen[:, :3, 3]),
            **({} if near is None else {"clearance": near.metrics}),
        }

    def notes(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> Iterator[str]:
        """Notes on the input, the start, incomplete controllers, and the closest bodies."""
        task = task_of(outcome)
        near = task.near(outcome.traces[STEP,])
        yield from (*task.notes(), *super().notes(numbers, outcome))
        yield from () if near is None else (near.note,)

    def live(self, config: Config, *, options: Mapping[str, str]) -> LiveProblem:
        """Live run along the mirrored recording, to and fro, until the user drags the hand; the option is `plant`."""
        return LiveMirror(config)
