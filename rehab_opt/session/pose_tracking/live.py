"""A followed pose, live: the circle goes round and round until somebody drags the target."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.clearance import AmongMoving
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import ARM_PLOTS, BLUE, ORANGE, ArmBodies, joint_rows, screen
from rehab_opt.session.live.problem import Following, LiveControl, LiveProblem
from rehab_opt.session.plant.making import joint_feedback, joint_plant
from rehab_opt.session.pose_tracking.problem import PoseTracking
from rehab_opt.session.pose_tracking.robot import circle_reference, robot_at_start, tracker_of

__all__ = ["LivePoseTracking"]

Array = NDArray[np.float64]


class LivePoseTracking(LiveProblem):
    """A `PoseTracker` with the file's robot and plant."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, loaded: ProblemFile[PoseTracking], *, solver: str | None) -> None:
        self._loaded, self._solver, self.title = loaded, solver, loaded.problem.title
        self.robot, self.start = robot_at_start(loaded)
        self.dt = 1 / loaded.problem.tracker.rate_hz
        self.names = tuple(self.robot.names)
        self.layout = {"q": self.robot.n, "target": 3, "force": 3}
        self._arm = ArmBodies(self.robot)

    @cached_property
    def reference(self) -> tuple[Array, Array]:
        """Poses (N, 4, 4) and twists (N, 6) of one pass of the circle, from rest to rest."""
        circle = self._loaded.problem.circle
        rate = self._loaded.problem.tracker.rate_hz
        times = self.dt * np.arange(round(circle.duration_s * rate) + 1, dtype=np.float64)
        return circle_reference(self.robot.pose(self.start), circle, times)

    def control(self) -> LiveControl:
        """The tracker of `rehab-opt run`."""
        problem = self._loaded.problem
        feedback = joint_feedback(problem.plant)
        tracker = tracker_of(problem, self.robot, file=self._loaded.file, solver=self._solver, feedback=feedback)
        plant, around = joint_plant(problem.plant, self.robot, self.dt), problem.clearance
        led = AmongMoving(tracker, around, self.dt) if around is not None and around.moving else tracker
        return Following(led, TouchedPlant(plant), self.start, *self.reference, then="again")

    def scene(self) -> dict[str, Any]:
        """The circle, the joints' limits, what is plotted."""
        path = self.reference[0][:: max(1, round(0.05 / self.dt)), :3, 3]
        return {
            **super().scene(),
            "lines": [{"points": path.round(4).tolist(), "colour": BLUE, "name": "reference"}],
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
        """The robot, its target, the push."""
        q, target, force = shown["q"], shown["target"], shown["force"]
        hand = self._arm.tool(q)[:, 3]
        margin = float(np.minimum(q - self.robot.lower, self.robot.upper - q).min())
        numbers = (
            1e3 * float(np.linalg.norm(hand - target)), math.degrees(margin), self.robot.manipulability(q),
            float(np.linalg.norm(force)),
        )  # fmt: skip
        return {
            "capsules": self._arm.capsules(q),
            "handles": {"target": target.round(4).tolist(), "hand": hand.round(4).tolist()},
            "arrows": [[*hand.tolist(), *force.tolist(), ORANGE]] if force.any() else [],
            "joints": q.round(4).tolist(),
            "numbers": [round(each, 4) for each in numbers],
        }
