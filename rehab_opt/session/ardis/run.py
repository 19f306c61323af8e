"""The run of `system = "ardis"`: each drive with the published law and with ours, each law steered on its own."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.mobile_arm import CHAIR
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.session.ardis.clearance import chair_corners, chair_gaps
from rehab_opt.session.ardis.measures import motion_metrics
from rehab_opt.session.ardis.outcome import (
    ArdisOutcome,
    DriveOutcome,
    Motion,
    Published,
    Steering,
    StickLaw,
    simulate_motion,
)
from rehab_opt.session.ardis.problem import ArdisProblem, DriveName
from rehab_opt.session.ardis.robot import joystick_of, resolver_of, robot_of, room_of, start_of, stick_of
from rehab_opt.session.ardis.stick import LET_GO, Moment
from rehab_opt.session.clearance import NearestBodies, clearance_of, nearest_bodies, start_notes
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import ARM_PLOTS, BLUE, GREEN, GREY, PURPLE, ArmBodies, joint_rows, kept_off, screen
from rehab_opt.session.live.problem import LiveControl, LiveProblem
from rehab_opt.session.outcome import Array, Progress, reason_counts
from rehab_opt.session.plant import chair_plant, plant_note
from rehab_opt.session.systems import ROBOT_FILE, Needed, NotMet, System

__all__ = ["ArdisSystem"]


WALL, ALONG, POST = 0.8, 4.0, 1.2
"""[m] Height and half of the length of a wall as it is drawn, height of a post."""


class LiveArdis(LiveProblem):
    """A `RedundancyResolver` with the file's chair, room, stick modes and plant; its first drive."""

    controls = frozenset({"stick", "push", "faults"})

    def __init__(self, config: ProblemFile[ArdisProblem], *, solver: str | None) -> None:
        self._config, self._solver = config, solver
        problem = config.problem
        self.drive = problem.stick.drives[0]
        self.title, self.dt = f"{problem.title} ({self.drive} drive)", 1 / problem.run.rate_hz
        self.robot, self.room = robot_of(config), room_of(config)
        self.start = start_of(config, self.robot)
        self.names = tuple(self.robot.chain.names)
        self.layout = {"q": self.encoders, "force": 3, "closed": 1}
        self._arm = ArmBodies(self.robot.chain, first=CHAIR, radius=self.robot.arm_radius)
        self._reached = 0

    def control(self, plant: Plant | None = None) -> LiveControl:
        """The joystick and resolver of `rehab-opt run`."""
        table, robot, own = self._config.problem.plant, self.robot, self._config.problem.robot.file is not None
        wheels, ideal = robot.drive(self.drive), table.kind == "ideal"
        if plant is None:
            made = IdealJoints(self.dt) if ideal else chair_plant(table, robot, wheels, self.dt, own_arm=own)
            plant = TouchedPlant(made)
        resolver = resolver_of(self._config, robot, self.drive, solver=self._solver)
        joystick, stick = joystick_of(self._config), stick_of(self._config, self.drive)
        return Steering(robot, resolver, joystick, stick, plant=plant, start=self.start, wheels=not ideal)

    def scene(self) -> dict[str, Any]:
        """Walls, posts, bodies that the arm keeps off, and goals."""
        walls = [each for each in self.room if isinstance(each, HalfPlane)]
        posts = [each for each in self.room if isinstance(each, Disc)]
        goals = [(*goal.hand_m, *goal.hand_m, 0.5 * goal.within_m, GREEN) for goal in self._config.problem.goals]
        hand, chair = self._arm.tool(self.start)[:, 3], [*self.start[:2], 0.5]
        places = np.array([hand, chair, *([*goal.hand_m] for goal in self._config.problem.goals)])
        around = kept_off(hand, clearance_of(self._config.problem.clearance, self._config.file))
        shapes = {
            "fills": [{"points": _wall(each), "colour": "#c3ccd5"} for each in walls],
            "capsules": [[*each.centre, 0.0, *each.centre, POST, each.radius, GREY] for each in posts] + goals,
            "legend": [[GREEN, "goals"], [PURPLE, "kept free for the user"]],
        }
        return {
            **super().scene(),
            **{name: shapes.get(name, []) + parts for name, parts in around.items()},
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
        goals = self._config.problem.goals
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


ROBOT_OF_PAPER = "lengths, masses and limits of the robot are assumptions: the paper gives joints and axes only"
ROBOT_OF_FILE = (
    "the chair, its user and what motors add to the joints are those of `ardis` and `arm_on_chair`: assumptions; where "
    "the arm's numbers are from its robot file says"
)
IGNORED = "the stick moves nothing"
STOPPED = "chair and arm brake or rest, whatever the stick asks for"
USER = "each controller is steered by a simulated user of its own, who watches the hand and moves the stick"
RECORDED = "the recorded stick does not react to the robot: each controller gets the same one"
SENT = "speeds and accelerations are those that were sent"


def _stick_notes(drive: DriveName, reasons: Sequence[str], dt: float, said: str) -> Iterator[NotMet]:
    """For how long, of ticks `dt` [s], it is as `said`, and why (empty where it is not)."""
    for reason, ticks in reason_counts(reasons).items():
        yield NotMet(f"{drive} drive: for {ticks * dt:.1f} s {said}: {reason}")


class ArdisSystem(System[ArdisProblem, ArdisOutcome]):
    """A wheelchair with an arm, moved by one stick, with each drive of the file."""

    schema = ArdisProblem
    shown = ("rehab_opt.session.ardis.shown",)
    options = frozenset({"plant", "solver"})
    solver_key = "run.solver"
    rate_key = "run.rate_hz"

    def recordings(self, problem: ArdisProblem) -> tuple[Needed, ...]:
        """The recordings of sticks, and the robot file where there is one."""
        sticks = tuple(Needed(f"stick.{drive}", file) for drive, file in problem.stick.recordings.items())
        return sticks if problem.robot.file is None else (*sticks, Needed(ROBOT_FILE, problem.robot.file))

    def check(self, config: ProblemFile[ArdisProblem]) -> tuple[str, ...]:
        """Reads the sticks and what they ask for, builds the robot and its controllers."""
        robot = robot_of(config)
        start = start_of(config, robot)
        notes = [*robot.chain.notes, *start_notes(config.problem.clearance, config.file, robot.bodied_chain, start)]
        for drive in config.problem.stick.drives:
            resolver_of(config, robot, drive)
            stick = stick_of(config, drive)
            if drive in config.problem.stick.simulated:
                continue
            joystick, dt = joystick_of(config), 1 / config.problem.run.rate_hz
            moments = (Moment(k * dt, start, start[:3], "") for k in range(math.ceil(stick.duration / dt) + 1))
            told = [joystick.step(**(stick.at(each) or LET_GO)._asdict()) for each in moments]
            notes += _stick_notes(drive, [each.reason for each in told], dt, IGNORED)
            if not any(each.reason or each.twist.any() for each in told):
                notes.append(NotMet(f"{drive} drive: the stick asks for nothing"))
        low = [goal.name for goal in config.problem.goals if goal.hand_m[2] < -goal.within_m]
        return (*notes, *(NotMet(f"goal {name!r} is below the floor") for name in low))

    def run(self, config: ProblemFile[ArdisProblem], *, options: Mapping[str, str], progress: Progress) -> ArdisOutcome:
        """Options: `solver` of the controller, `plant`."""
        problem, robot = config.problem, robot_of(config)
        start, room = start_of(config, robot), room_of(config)
        dt = 1 / problem.run.rate_hz

        def run(drive: DriveName, name: str, law: StickLaw) -> Motion:
            table, plant = problem.plant, None
            if table.kind != "ideal":
                plant = chair_plant(table, robot, robot.drive(drive), dt, own_arm=problem.robot.file is not None)
            return simulate_motion(
                robot, law, joystick_of(config), stick_of(config, drive), start, dt=dt, plant=plant,
                progress=lambda done, of: progress(f"{drive}, {name} law", done, of),
            )  # fmt: skip

        drives: dict[DriveName, DriveOutcome] = {}
        near: dict[DriveName, NearestBodies] = {}
        for drive in problem.stick.drives:
            ours = resolver_of(config, robot, drive, solver=options.get("solver"))
            theirs = Published(PseudoinverseLaw(robot, drive=drive, self_motion=problem.run.self_motion))
            drives[drive] = DriveOutcome(
                published=run(drive, "published", theirs), optimised=run(drive, "optimised", ours)
            )
            ran = drives[drive].optimised
            seen = nearest_bodies(problem.clearance, config.file, robot.bodied_chain, ran.q, ran.time)
            near |= {} if seen is None else {drive: seen}
        metrics = {
            drive: {law: motion_metrics(robot, drive, of, room, problem.goals) for law, of in outcome.by_law.items()}
            for drive, outcome in drives.items()
        }
        return ArdisOutcome(
            notes=(
                *(
                    note
                    for drive, of in drives.items()
                    for reasons, said in ((of.optimised.ignored, IGNORED), (of.optimised.stopped, STOPPED))
                    for note in _stick_notes(drive, reasons, dt, said)
                ),
                plant_note(
                    problem.plant,
                    "the robot is simulated: chair and arm move exactly as commanded, whichever law commands",
                ),
                *((USER,) if problem.stick.simulated else ()),
                *((RECORDED,) if problem.stick.recordings else ()),
                *(() if problem.plant.kind == "ideal" else (SENT,)),
                ROBOT_OF_PAPER if problem.robot.file is None else ROBOT_OF_FILE,
                "walls and posts are kept from the chair's outline; the arm may reach over them",
                *robot.chain.notes,
                *(f"{drive} drive: {seen.note}" for drive, seen in near.items()),
            ),
            metrics={
                "drives": metrics,
                **({"clearance": {drive: seen.metrics for drive, seen in near.items()}} if near else {}),
            },
            robot=robot,
            room=room,
            goals=tuple(problem.goals),
            drives=drives,
            near=near,
        )

    def live(self, config: ProblemFile[ArdisProblem], *, options: Mapping[str, str]) -> LiveProblem:
        """The stick in somebody's hand; options as of `run`."""
        return LiveArdis(config, solver=options.get("solver"))
