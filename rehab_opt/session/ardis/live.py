"""A wheelchair with an arm, live: somebody at the page has the stick."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.mobile_arm import CHAIR
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.ardis.clearance import chair_corners, chair_gaps
from rehab_opt.session.ardis.outcome import LET_GO, Steering
from rehab_opt.session.ardis.problem import ArdisProblem
from rehab_opt.session.ardis.robot import joystick_of, resolver_of, robot_of, room_of, start_of
from rehab_opt.session.ardis.stick import Moment, StickRecording, sticks_of
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import ARM_PLOTS, BLUE, GREEN, GREY, PURPLE, ArmBodies, joint_rows, screen
from rehab_opt.session.live.problem import LiveControl, LiveInputs, LiveProblem
from rehab_opt.session.plant.making import chair_plant, joint_feedback

__all__ = ["LiveArdis"]

Array = NDArray[np.float64]

WALL, ALONG, POST = 0.8, 4.0, 1.2
"""[m] Height and half of the length of a wall as it is drawn, height of a post."""


class LiveArdis(LiveProblem):
    """A `RedundancyResolver` with the file's chair, room, stick modes and plant; its first drive."""

    controls = frozenset({"stick", "push", "faults"})

    def __init__(self, loaded: ProblemFile[ArdisProblem], *, solver: str | None) -> None:
        self._loaded, self._solver = loaded, solver
        problem = loaded.problem
        self.drive = next(iter(problem.stick.recordings))
        self.title, self.dt = f"{problem.title} ({self.drive} drive)", 1 / problem.run.rate_hz
        self.robot, self.room = robot_of(loaded), room_of(loaded)
        self.start = start_of(loaded, self.robot)
        self.names = tuple(self.robot.chain.names)
        self.layout = {"q": self.encoders, "force": 3, "closed": 1}
        self._arm = ArmBodies(self.robot.chain, first=CHAIR, radius=self.robot.arm_radius)
        self._reached = 0

    def control(self) -> LiveControl:
        """The joystick and resolver of `rehab-opt run`."""
        table, robot, own = self._loaded.problem.plant, self.robot, self._loaded.problem.robot.file is not None
        wheels, ideal = robot.drive(self.drive), table.kind == "ideal"
        plant = IdealJoints(self.dt) if ideal else chair_plant(table, robot, wheels, self.dt, own_arm=own)
        resolver = resolver_of(self._loaded, robot, self.drive, solver=self._solver, feedback=joint_feedback(table))
        return Steering(joystick_of(self._loaded), resolver, TouchedPlant(plant), self.start, wheels=not ideal)

    def untouched(self, time: float) -> LiveInputs:
        """The file's recording of the stick."""
        sample = self._recorded.at(Moment(time, self.start, self.start[:3], "")) or LET_GO
        return LiveInputs(enable=True, stick=sample.axes, switch=sample.switch, gripper=sample.gripper)

    @cached_property
    def _recorded(self) -> StickRecording:
        return sticks_of(self._loaded)[self.drive]

    def scene(self) -> dict[str, Any]:
        """Walls, posts and goals."""
        walls = [each for each in self.room if isinstance(each, HalfPlane)]
        posts = [each for each in self.room if isinstance(each, Disc)]
        goals = [(*goal.hand_m, *goal.hand_m, 0.5 * goal.within_m, GREEN) for goal in self._loaded.problem.goals]
        hand, chair = self._arm.tool(self.start)[:, 3], [*self.start[:2], 0.5]
        places = np.array([hand, chair, *([*goal.hand_m] for goal in self._loaded.problem.goals)])
        return {
            **super().scene(),
            "fills": [{"points": _wall(each), "colour": "#c3ccd5"} for each in walls],
            "capsules": [[*each.centre, 0.0, *each.centre, POST, each.radius, GREY] for each in posts] + goals,
            "legend": [[GREEN, "goals"], [PURPLE, "kept free for the user"]],
            "joints": joint_rows(self.robot.chain),
            "noise": "mrad or mm",
            "plots": [
                {"name": "chair to obstacles", "unit": "m", "least": 0.2},
                *ARM_PLOTS,
            ],
            "centre": [*(0.5 * (places.min(axis=0) + places.max(axis=0)))[:2].tolist(), 0.5],
            "reach": 2.0 + 0.7 * float(np.ptp(places, axis=0).max()),
            "turn": -2.0,
            "screen": screen(np.vstack([places, hand + 0.3 * np.eye(3)[:2]])),
        }

    def _goal(self, hand: Array, *, closed: bool) -> dict[str, Any]:
        """Where the participant's screen shows that the hand is to go: the first goal that it was not at."""
        goals = self._loaded.problem.goals
        while self._reached < len(goals) - 1 and goals[self._reached].met(hand, closed):
            self._reached += 1
        return {"goal": goals[self._reached].hand_m} if goals else {}

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Chair, user and arm."""
        q, force, robot = shown["q"], shown["force"], self.robot
        hand = self._arm.tool(q)[:, 3]
        corners = np.hstack([chair_corners(robot.outline, q[None])[0], np.full((4, 1), 0.04)])
        turn = np.array([[math.cos(q[2]), -math.sin(q[2])], [math.sin(q[2]), math.cos(q[2])]])

        def placed(point: tuple[float, float, float]) -> list[float]:
            return [*(turn @ point[:2] + q[:2]).tolist(), point[2]]

        person = [[*placed(each.start), *placed(each.end), each.radius, PURPLE] for each in robot.keep_out]
        gaps = chair_gaps(robot.outline, self.room, q[None])
        ended = np.isfinite(robot.chain.lower)
        margin = np.minimum(q - robot.chain.lower, robot.chain.upper - q)[ended].min(initial=math.inf)
        numbers = (
            float(gaps.min(initial=math.inf)), math.degrees(margin), robot.chain.manipulability(q),
            float(np.linalg.norm(force)),
        )  # fmt: skip
        return {
            "capsules": [*self._arm.capsules(q), *person],
            "lines": [{"points": [*corners.tolist(), corners[0].tolist()], "colour": BLUE, "radius": 0.02}],
            "handles": {"hand": hand.round(4).tolist()},
            **self._goal(hand, closed=bool(shown["closed"].ravel()[0])),
            "arrows": [[*hand.tolist(), *force.tolist(), "#e69f00"]] if force.any() else [],
            "joints": q.round(4).tolist(),
            "numbers": list(numbers),
        }


def _wall(wall: HalfPlane) -> list[list[float]]:
    """A rectangle on the wall's line, about the point of it that is nearest to the origin."""
    normal = np.asarray(wall.normal) / np.hypot(*wall.normal)
    foot, along = wall.offset * normal, ALONG * np.array([-normal[1], normal[0]])
    a, b = (foot - along).tolist(), (foot + along).tolist()
    return [[*a, 0.0], [*b, 0.0], [*b, WALL], [*a, WALL]]
