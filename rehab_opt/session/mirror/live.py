"""A mirrored hand live: the tracker of `rehab-opt run`, with the recording to and fro, or with a dragged hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.command import Command
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.clearance import clearance_of, planes_of
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import BLUE, GREEN, ORANGE, ArmBodies, joint_rows, kept_off, near_limit, screen
from rehab_opt.session.live.problem import Following, LiveControl, LiveProblem
from rehab_opt.session.mirror.laws import tracker_of
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import laid_out
from rehab_opt.session.outcome import Array
from rehab_opt.session.plant import device_of, joint_plant

__all__ = ["LiveMirror"]

FRAME = 1 / 30
"""[s] Time between pictures, the step of the person's arm."""


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
        """The mirrored path, keep-out planes, and limits of the person or else the robot."""
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
                {"name": "manipulability, fraction of the largest", "unit": "", "line": section.floor},
                {"name": "behind the recording", "unit": "s", "least": 0.5},
                {"name": "joint-limit margin", "unit": "deg"},
                {"name": "force", "unit": "N", "least": 10.0},
            ],
            "centre": path.mean(axis=0).round(3).tolist(),
            "reach": 1.3,
        }

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Robot, the patient's arm, and the reference."""
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
