"""The run of `system = "mirror"`: the recording laid out, every law on it, and the numbers; what it is live."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.command import Command
from rehab_opt.control.conditioning import Conditioner
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.clearance import clearance_of, nearest_bodies, planes_of, start_notes
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import BLUE, GREEN, ORANGE, ArmBodies, joint_rows, kept_off, near_limit, screen
from rehab_opt.session.live.problem import Following, LiveControl, LiveProblem
from rehab_opt.session.mirror.laws import ANY_SPEED, planned, searched, track_reference, tracker_of, without_floor
from rehab_opt.session.mirror.metrics import astar_metrics, causes, driven, led_metrics
from rehab_opt.session.mirror.outcome import BEFORE, PLAN, STEP, Led, MirrorOutcome
from rehab_opt.session.mirror.placing import reach_note
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import Setup, laid_out, path_notes
from rehab_opt.session.outcome import Array, Progress
from rehab_opt.session.plant import device_of, joint_plant, plant_note
from rehab_opt.session.robot_file import robot_files
from rehab_opt.session.systems import Needed, System

__all__ = ["MirrorSystem"]

FRAME = 1 / 30
"""[s] from picture to picture, in which the person's arm is led on."""


class LiveMirror(LiveProblem):
    """A `MirrorTracker` with the file's recording, patient, robot and plant."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, config: ProblemFile[MirrorProblem]) -> None:
        self._config, self.title, self.dt = config, config.problem.title, 1 / config.problem.tracker.rate_hz
        self._scene, self.device = laid_out(config), device_of(config.problem.plant)
        self.robot = self._scene.robot
        self.names = tuple(self.robot.names)
        self.layout = {"q": self.robot.n, "reference": 3, "target": 3, "force": 3, "lag": 1, "manipulability": 1}
        self._arm = ArmBodies(self.robot)
        self._person: tuple[ArmBodies, PersonLimit] | None = None
        if self._scene.person is not None:
            person, grip = self._scene.person
            said = config.problem.patient.arm
            start = None if said is None or said.start_deg is None else np.deg2rad(said.start_deg)
            self._person = ArmBodies(person), PersonLimit(person, grip=grip, dt=FRAME, start=start, backup=None)

    def control(self, plant: Plant | None = None) -> LiveControl:
        """The tracker of `rehab-opt run`."""
        problem, scene = self._config.problem, self._scene
        tracker = tracker_of(problem, scene, file=self._config.file, live=True)
        plant = TouchedPlant(joint_plant(problem.plant, self.robot, self.dt)) if plant is None else plant
        reference = scene.reference
        seen = ~reference.lost
        return _Mirroring(tracker, plant, scene.start, reference.poses[seen], reference.twists[seen])

    def scene(self) -> dict[str, Any]:
        """The mirrored path, planes that are kept clear of, limits of the person or else the robot."""
        reference, section = self._scene.reference, self._config.problem.tracker
        path = reference.poses[~reference.lost][:: max(1, round(0.05 / self.dt)), :3, 3]
        file = self._config.file
        planes = planes_of(section.keep_out, file, "tracker.keep_out")
        bodies = kept_off(path.mean(axis=0), clearance_of(self._config.problem.clearance, file), planes)
        shown = joint_rows(self.robot if self._person is None else self._person[0].chain)
        return {
            **super().scene(),
            **bodies,
            "lines": [{"points": path.round(4).tolist(), "colour": BLUE}, *bodies["lines"]],
            "legend": [[BLUE, "mirrored path"], *bodies["legend"]]
            + ([] if self._person is None else [[GREEN, "the person's arm, red near a limit"]]),
            "screen": screen(path),
            "joints": shown,
            "jointtitle": "The person's joints within their range" if self._person else "Joints within their limits",
            "noise": "mrad",
            "plots": [
                {"name": "hand from the mirrored pose", "unit": "mm", "line": section.max_deviation_mm},
                {"name": "manipulability, share of largest", "unit": "", "line": section.floor},
                {"name": "behind the recording", "unit": "s", "least": 0.5},
                {"name": "joint-limit margin", "unit": "deg"},
                {"name": "force", "unit": "N", "least": 10.0},
            ],
            "centre": path.mean(axis=0).round(3).tolist(),
            "reach": 1.3,
        }

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Robot, the arm that it leads, what is asked."""
        q, force = shown["q"], shown["force"]
        pose = np.vstack([self._arm.tool(q), [0.0, 0.0, 0.0, 1.0]])
        hand, chain, joints = pose[:3, 3], self.robot, q
        capsules = self._arm.capsules(q)
        if self._person is not None:
            bodies, limit = self._person
            limit.limited(pose, np.zeros(6))
            assert limit.q is not None
            chain, joints = bodies.chain, limit.q
            colours = [near_limit(each) for each in np.minimum(joints - chain.lower, chain.upper - joints)]
            capsules += bodies.capsules(joints, colours)
        margin = np.minimum(joints - chain.lower, chain.upper - joints)[chain.lower < chain.upper].min()
        numbers = (
            1e3 * float(np.linalg.norm(hand - shown["reference"])), float(shown["manipulability"][0]),
            float(shown["lag"][0]), math.degrees(margin), float(np.linalg.norm(force)),
        )  # fmt: skip
        return {
            "capsules": capsules,
            "handles": {"target": shown["target"].round(4).tolist(), "hand": hand.round(4).tolist()},
            "arrows": [[*hand.tolist(), *force.tolist(), ORANGE]] if force.any() else [],
            "joints": joints.round(4).tolist(),
            "numbers": list(numbers),
        }


class _Mirroring(Following):
    def __init__(self, tracker: MirrorTracker, plant: Plant, start: Array, poses: Array, twists: Array) -> None:
        super().__init__(tracker, plant, start, poses, twists, then="back")
        self._mirror = tracker

    def track(self, seen: Measurement, twist: Array, *, enable: bool) -> Command:
        return self._mirror.step(
            seen.position, self.target, twist, force=seen.force, enable=enable, stamp=self.stamp(seen)
        )

    def shown(self) -> dict[str, ArrayLike]:
        tracker = self._mirror
        return super().shown() | {
            "reference": tracker.reference[:3, 3], "lag": tracker.lag, "manipulability": tracker.manipulability
        }  # fmt: skip


FAR = 1e-3
"""[m] from the first reference pose, where a start is told to be elsewhere."""


def _notes(problem: MirrorProblem, scene: Setup, laws: dict[str, Led], tracker: MirrorTracker) -> Iterator[str]:
    yield "a reconstruction: the equations of the paper (Xu, Guo, Zhang 2021) are lost from the text at hand"
    yield plant_note(problem.plant, "the robot is simulated: its joints move exactly as commanded")
    if problem.plant.kind != "ideal":
        yield "the plan is a plan: only what goes tick by tick was run on that robot"
    first = scene.reference.poses[~scene.reference.lost][0]
    away = float(np.linalg.norm(scene.robot.pose(scene.start)[:3, 3] - first[:3, 3]))
    if away > FAR:
        yield f"the robot starts {1e3 * away:.0f} mm from the first pose, and goes there first; '{BEFORE}' begins there"
    if scene.person is not None:
        yield "the reference is limited to the led arm's range of motion; distances are to the mirrored one"
    w = scene.robot.manipulability(scene.start) / tracker.max_manipulability
    if w < problem.tracker.floor:
        yield f"the robot starts below the floor, at {w:.3f}"
    for i, plane in enumerate(tracker.hand_bounds.planes):
        height = tracker.hand_bounds.min_heights(scene.start[None], plane).item()
        if height < 0.0:
            yield f"the robot starts {-1e3 * height:.3g} mm inside tracker.keep_out.{i}, and goes no deeper"
    for name, led in laws.items():
        if not led.complete:
            yield f"{name}: INCOMPLETE, the reference's end was not reached within the patience"


class MirrorSystem(System[MirrorProblem, Any]):
    """A hand led along the other hand's mirrored path."""

    schema = MirrorProblem

    def figures(self, outcome: Any) -> dict[str, Any]:
        """The figures by file name, without suffix."""
        from rehab_opt.session.mirror.shown import figures  # noqa: PLC0415  (draws)

        return figures(outcome)

    first = (
        "drive: passed", "drive: deviation", "drive: duration", "complete", "drive: manipulability", "below_floor",
        "drive: seconds_by_cause", "joint_limit_margin", "status",
    )  # fmt: skip
    options = frozenset({"plant"})
    rate_key = "tracker.rate_hz"

    def columns(self, outcome: Any) -> Mapping[str, Mapping[str, Any]]:
        """A column for each controller; A* is a path without times and without a robot that follows it."""
        laws, astar = dict(outcome.metrics["laws"]), outcome.metrics["astar"]
        if astar is not None:
            name = f"A*, {outcome.metrics['parameters']['astar']['resolution_mm']:g} mm"
            laws[name] = {"drive": {key: of for key, of in astar.items() if key != "complete"}} | astar
        return laws

    def caption(self, outcome: Any) -> str:
        """The floor, and what was asked for."""
        reference = outcome.metrics["reference"]
        return (
            f"floor {outcome.floor:g} of the robot's largest manipulability; reference of "
            f"{reference['duration_s']:.1f} s, up to {reference['speed_max_m_s']:.2g} m/s, above the cap "
            f"{100 * reference['faster_than_cap_fraction_of_time']:.0f} % of the time; "
            f"filter lag {1e3 * reference['filter_lag_s']:.0f} ms; passed: within 5 mm and 5 deg"
        )

    def recordings(self, problem: MirrorProblem) -> tuple[Needed, ...]:
        """Poses of the hand and of the patient, the points that tell where they were seen, and the robot file."""
        files = {
            "recording.file": problem.recording.file,
            "patient.track_file": problem.patient.track_file,
            "placement.calibration_file": problem.placement.calibration_file,
        }
        return (*(Needed(key, name) for key, name in files.items() if name is not None), *robot_files(problem.robot))

    def check(self, config: ProblemFile[MirrorProblem]) -> tuple[str, ...]:
        """Reads the recording, lays it out, builds the tracker, and counts what the robot reaches."""
        scene = laid_out(config)
        tracker = tracker_of(config.problem, scene, file=config.file)
        within = start_notes(config.problem.clearance, config.file, scene.robot, scene.start)
        return (*scene.notes, *within, *path_notes(scene), reach_note(config.problem, scene, tracker))

    def run(
        self, config: ProblemFile[MirrorProblem], *, options: Mapping[str, str], progress: Progress
    ) -> MirrorOutcome:
        """The option is `plant`."""
        problem, scene = config.problem, laid_out(config)
        section, reference, robot = problem.tracker, scene.reference, scene.robot
        tracker = tracker_of(problem, scene, file=config.file)
        max_manipulability, rate, bounds = tracker.max_manipulability, section.rate_hz, tracker.hand_bounds
        plant = joint_plant(problem.plant, robot, 1.0 / rate)
        laws = {
            BEFORE: without_floor(scene, plant, max_manipulability=max_manipulability, progress=progress),
            STEP: track_reference(tracker, scene, plant, patience=section.patience, progress=progress),
            PLAN: planned(tracker, scene, progress=progress),
        }
        speeds = {BEFORE: ANY_SPEED, STEP: section.linear_speed_m_s, PLAN: section.linear_speed_m_s}
        drives = {
            name: driven(
                led, robot, problem.smoothing, linear_speed=speeds[name], max_manipulability=max_manipulability
            )
            for name, led in laws.items()
        }
        why = {name: causes(led, drives[name], bounds) for name, led in laws.items()}
        near = nearest_bodies(problem.clearance, config.file, robot, laws[STEP].q, laws[STEP].time)
        astar = searched(problem, scene, max_manipulability=max_manipulability, progress=progress)
        references = reference.poses[~reference.lost]
        fast = np.linalg.norm(reference.twists[~reference.lost, :3], axis=1)
        metrics: dict[str, Any] = {
            "reference": {
                "duration_s": float(reference.times[-1] - reference.times[0]),
                "samples": len(reference.poses),
                "samples_lost": int(reference.lost.sum()),
                "samples_dropped": reference.dropped,
                "gaps": reference.gaps,
                "speed_max_m_s": float(fast.max()),
                "faster_than_cap_fraction_of_time": float(np.mean(fast > section.linear_speed_m_s)),
                "filter_lag_s": Conditioner(1 / rate, cutoff_hz=problem.conditioning.cutoff_hz).lag,
                "calibration_rms_m": scene.fit.rms if scene.fit is not None else None,
                "scale": problem.placement.scale,
            },
            "manipulability_max": max_manipulability,
            "laws": {
                name: led_metrics(led, drives[name], bounds, references, cause=why[name], rate=rate)
                for name, led in laws.items()
            },
            "astar": None if astar is None else astar_metrics(astar, bounds, references[:, :3, 3]),
            **({} if near is None else {"clearance": near.metrics}),
        }
        return MirrorOutcome(
            chain=robot,
            time=reference.times - reference.times[0],
            notes=(
                *scene.notes,
                *path_notes(scene),
                *_notes(problem, scene, laws, tracker),
                *([] if near is None else [near.note]),
            ),
            metrics=metrics,
            mirror=scene.mirror,
            reference=reference.poses,
            recorded=scene.recorded,
            laws=laws,
            drives=drives,
            causes=why,
            astar=astar,
            **section.arguments("floor", "max_deviation_mm", "linear_speed_m_s"),
            near=near,
        )

    def live(self, config: ProblemFile[MirrorProblem], *, options: Mapping[str, str]) -> LiveProblem:
        """The mirrored recording to and fro, until somebody drags the hand; the option is `plant`."""
        return LiveMirror(config)
