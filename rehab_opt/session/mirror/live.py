"""A mirrored hand live: the tracker of `rehab-opt run` follows the recording to and fro, or a dragged target."""

from __future__ import annotations

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
from rehab_opt.session.live.bodies import BLUE, GREEN, ArmBodies, joint_rows, kept_off, near_limit, screen
from rehab_opt.session.live.problem import Following, LiveControl
from rehab_opt.session.mirror.laws import tracker_of
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import laid_out
from rehab_opt.session.outcome import Array
from rehab_opt.session.plant import device_of, joint_plant
from rehab_opt.session.scene import Plot, Scene, arm_plots

FRAME = 1 / 30
"""[s] Time between two pictures, and time step of the person's arm."""


class LiveMirror(Scene):
    """A `MirrorTracker` with the file's recording, patient, robot and plant."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, config: ProblemFile[MirrorProblem]) -> None:
        problem = config.problem
        section, file = problem.tracker, config.file
        self._config, self.title, self.dt = config, problem.title, 1 / section.rate_hz
        self._setup, self.device = laid_out(config), device_of(problem.plant)
        self.chain = self._setup.robot
        self.names, self.bodies = tuple(self.chain.names), ArmBodies(self.chain)
        self.layout = {"q": self.chain.n, "reference": 3, "target": 3, "force": 3, "lag": 1, "manipulability": 1}
        self._person: tuple[ArmBodies, PersonLimit] | None = None
        if self._setup.person is not None:
            person, grip = self._setup.person
            limit = PersonLimit(person, grip=grip, dt=FRAME, start=problem.patient.arm_start, backup=None)
            self._person = ArmBodies(person), limit
        shown = self.chain if self._person is None else self._person[0].chain
        margin, _, force = arm_plots(shown)
        self.plots = (
            Plot("hand from the mirrored pose", "mm", _away, {"line": section.max_deviation_mm}),
            Plot(
                "manipulability, fraction of the largest", "", lambda of: of["manipulability"][0],
                {"line": section.floor},
            ),
            Plot("behind the recording", "s", lambda of: of["lag"][0], {"least": 0.5}),
            Plot("joint-limit margin", "deg", lambda of: margin.of({"q": of["joints"]})),
            force,
        )  # fmt: skip
        reference = self._setup.reference
        path = reference.poses[~reference.lost][:: max(1, round(0.05 / self.dt)), :3, 3]
        planes = planes_of(section.keep_out, file, "tracker.keep_out")
        around = kept_off(path.mean(axis=0), clearance_of(problem.clearance, file), planes)
        person_words = [] if self._person is None else [[GREEN, "the person's arm, red near a limit"]]
        self.still = {
            **around,
            "lines": [{"points": path.round(4).tolist(), "colour": BLUE}, *around["lines"]],
            "legend": [[BLUE, "mirrored path"], *around["legend"], *person_words],
            "screen": screen(path),
            "joints": joint_rows(shown),
            "jointtitle": "The person's joints within their range" if self._person else "Joints within their limits",
            "centre": path.mean(axis=0).round(3).tolist(),
            "reach": 1.3,
        }

    def control(self, plant: Plant | None = None) -> LiveControl:
        """Control with the tracker of `rehab-opt run`."""
        problem, setup = self._config.problem, self._setup
        tracker = tracker_of(problem, setup, file=self._config.file, live=True)
        plant = TouchedPlant(joint_plant(problem.plant, self.chain, self.dt)) if plant is None else plant
        reference = setup.reference
        seen = ~reference.lost
        return _Mirroring(tracker, plant, setup.start, reference.poses[seen], reference.twists[seen])

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Data of a picture: robot, the patient's arm, and the reference."""
        if self._person is None:
            return super().frame({**shown, "joints": shown["q"]})
        bodies, limit = self._person
        limit.limited(np.vstack([self.bodies.tool(shown["q"]), [0.0, 0.0, 0.0, 1.0]]), np.zeros(6))
        joints, chain = limit.q, bodies.chain
        assert joints is not None
        colours = [near_limit(each) for each in np.minimum(joints - chain.lower, chain.upper - joints)]
        frame = super().frame({**shown, "joints": joints})
        capsules = [*frame["capsules"], *bodies.capsules(joints, colours)]
        return frame | {"capsules": capsules, "joints": joints.round(4).tolist()}


def _away(of: Mapping[str, Array]) -> float:
    return 1e3 * float(np.linalg.norm(of["hand"] - of["reference"]))


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
