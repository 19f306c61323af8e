"""`system = "ardis"`: each drive is run with the published controller and with ours, each with its own user."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics import DriveName
from rehab_opt.kinematics.mobile_arm import CHAIR
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.session.ardis.clearance import chair_corners, chair_gaps
from rehab_opt.session.ardis.measures import motion_metrics
from rehab_opt.session.ardis.problem import ArdisProblem
from rehab_opt.session.ardis.robot import joystick_of, resolver_of, robot_of, room_of, start_of, stick_of
from rehab_opt.session.ardis.steering import NO_ANSWER, Published, Steering
from rehab_opt.session.ardis.stick import LET_GO, Moment
from rehab_opt.session.clearance import NearestBodies, clearance_of, nearest_bodies, start_notes
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import BLUE, GREEN, GREY, PURPLE, ArmBodies, kept_off, screen
from rehab_opt.session.live.problem import LiveInputs, LiveProblem
from rehab_opt.session.outcome import Array, Names, Outcome, reason_counts
from rehab_opt.session.plant import chair_plant, plant_note
from rehab_opt.session.scene import Plot, Scene, SceneSystem, arm_plots
from rehab_opt.session.systems import NotMet
from rehab_opt.session.trace import Trace

Config = ProblemFile[ArdisProblem]
LAWS = ("published", "optimised")
STANDSTILL = 1.0
"""[s] A run ends this long after the last release of the stick, so that the robot comes to rest."""
WALL, ALONG, POST = 0.8, 4.0, 1.2
"""[m] Sizes in the picture: height and half length of a wall, and height of a post."""


class ArdisScene(Scene):
    """Scene of a drive: a `RedundancyResolver` or the published controller, with the file's chair, stick and plant."""

    controls = frozenset({"stick", "push", "faults"})
    noise = "mrad or mm"

    def __init__(self, config: Config, solver: str | None, drive: DriveName, law: str = "optimised") -> None:
        self._config, self._solver, self.drive, self.law, self._reached = config, solver, drive, law, 0
        problem = self.problem = config.problem
        self.title, self.dt = f"{problem.title} ({drive} drive)", 1 / problem.run.rate_hz
        self.robot, self.room = robot_of(config), room_of(config)
        self.chain, self.start = self.robot.chain, start_of(config, self.robot)
        self.names = tuple(self.chain.names)
        self.layout = {"q": self.encoders, "force": 3, "closed": 1}
        self.ticks = math.ceil((stick_of(config, drive).duration + STANDSTILL) / self.dt) + 1
        self.bodies = ArmBodies(self.chain, first=CHAIR, radius=self.robot.arm_radius)

        def gap(of: Mapping[str, Any]) -> float:
            return float(chair_gaps(self.robot.outline, self.room, of["q"][None]).min(initial=math.inf))

        self.plots = (Plot("chair to obstacles", "m", gap, {"least": 0.2}), *arm_plots(self.chain))
        hand, goals = self.bodies.tool(self.start)[:, 3], problem.goals
        places = np.array([hand, [*self.start[:2], 0.5], *([*goal.hand_m] for goal in goals)])
        walls = [each for each in self.room if isinstance(each, HalfPlane)]
        posts = [each for each in self.room if isinstance(each, Disc)]
        shapes: dict[str, list[Any]] = {
            "fills": [{"points": _wall(each), "colour": "#c3ccd5"} for each in walls],
            "capsules": [
                *([*each.centre, 0.0, *each.centre, POST, each.radius, GREY] for each in posts),
                *([*goal.hand_m, *goal.hand_m, 0.5 * goal.within_m, GREEN] for goal in goals),
            ],
            "legend": [[GREEN, "goals"], [PURPLE, "kept free for the user"]],
        }
        around = kept_off(hand, clearance_of(problem.clearance, config.file))
        self.still = {
            **{name: shapes.get(name, []) + parts for name, parts in around.items()},
            "centre": [*(0.5 * (places.min(axis=0) + places.max(axis=0)))[:2].tolist(), 0.5],
            "reach": 2.0 + 0.7 * float(np.ptp(places, axis=0).max()),
            "turn": -2.0,
            "screen": screen(np.vstack([places, hand + 0.3 * np.eye(3)[:2]])),
        }

    def control(self, plant: Plant | None = None) -> Steering:
        """Closed loop of stick, controller and `plant`, by default the file's plant."""
        table, robot, own = self.problem.plant, self.robot, self.problem.robot.file is not None
        wheels, ideal = robot.drive(self.drive), table.kind == "ideal"
        if plant is None:
            made = IdealJoints(self.dt) if ideal else chair_plant(table, robot, wheels, self.dt, own_arm=own)
            plant = TouchedPlant(made)
        published = PseudoinverseLaw(robot, drive=self.drive, self_motion=self.problem.run.self_motion)
        ours = self.law != "published"
        law = resolver_of(self._config, robot, self.drive, solver=self._solver) if ours else Published(published)
        joystick, stick = joystick_of(self._config), stick_of(self._config, self.drive)
        return Steering(robot, law, joystick, stick, plant=plant, start=self.start, wheels=not ideal)

    def inputs(self, k: int, control: Steering) -> LiveInputs | None:
        """Inputs of the stick; None ends the run one second after the last release of the stick."""
        return None if control.ticks_let_go >= math.ceil(STANDSTILL / self.dt) else super().inputs(k, control)

    def also(self, control: Steering, command: Command) -> dict[str, Any]:
        """Trace columns of the stick and the wheels."""
        commanded = control.commanded
        return {
            "stick": control.axes,
            "stick_mode": control.mode,
            "stick_ignored": commanded.reason,
            "stopped": "" if command.status.certified else command.reason,
            "gripper_closed": commanded.gripper_closed,
            "_asked": bool(commanded.twist.any()),
            "wheel": np.empty(0) if command.wheels is None else command.wheels,
        }

    def derived(self, trace: Trace) -> None:
        """Add the hand's columns; convert the chair's commands to the chair frame, in which the limits are defined."""
        q, world, chain = trace["joint"], trace["command"], self.chain
        trace |= {
            "_world": world,
            "command": np.array([self.robot.chassis_velocity(*each) for each in zip(q, world, strict=True)]),
            "pose": np.array([chain.pose(each) for each in q]),
            "jacobian": np.array([chain.jacobian(each) for each in q]),
            "status": np.where(trace["reason"] == NO_ANSWER, NO_ANSWER, trace["status"]),
        }
        trace["hand"] = trace["pose"][:, :3, 3]
        trace["_wheel_use"] = np.abs(trace["wheel"]) / self.robot.drive(self.drive).limit
        joints = [f"{name}_{'m' if i < 2 else 'rad'}" for i, name in enumerate(self.names)]
        rates = [f"{name}_s" for name in joints]
        trace.parts |= {"joint": joints, "measured": joints, "command": rates, "velocity": rates}
        wheels = [f"{i + 1}_rad_s" for i in range(trace["wheel"].shape[1])]
        trace.parts |= {"stick": ("forward", "left"), "wheel": wheels}

    def near(self, trace: Trace) -> NearestBodies | None:
        """Distances of the robot from the bodies of `[clearance]`; None without this table."""
        robot, section = self.robot.bodied_chain, self.problem.clearance
        return nearest_bodies(section, self._config.file, robot, trace["joint"], trace["t_s"])

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics of goals, chair and arm, kinetic energy and limits; for our controller also distances to bodies."""
        numbers = motion_metrics(self.robot, self.drive, trace, self.dt, room=self.room, goals=self.problem.goals)
        near = self.near(trace) if self.law == "optimised" else None
        return numbers if near is None else numbers | {"clearance": near.metrics}

    def notes(self, trace: Trace) -> Iterator[str]:
        """Notes on when and why our controller did not move the robot, on the user, the plant, and closest bodies."""
        if self.law == "published":
            return
        yield from _stick_notes(self.drive, trace["stick_ignored"].tolist(), self.dt, IGNORED)
        yield from _stick_notes(self.drive, trace["stopped"].tolist(), self.dt, STOPPED)
        problem = self.problem
        ideal = "the robot is simulated: chair and arm move exactly as commanded, whichever controller commands"
        yield plant_note(problem.plant, ideal)
        yield from (USER,) if problem.stick.simulated else ()
        yield from (RECORDED,) if problem.stick.recordings else ()
        yield from () if problem.plant.kind == "ideal" else (SENT,)
        yield ROBOT_OF_PAPER if problem.robot.file is None else ROBOT_OF_FILE
        yield "the chair's outline avoids walls and posts; the arm may reach over them"
        yield from self.chain.notes
        near = self.near(trace)
        yield from () if near is None else (f"{self.drive} drive: {near.note}",)

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Data of the page's frame: chair, user and arm, and the next goal for the participant's screen."""
        q, robot, goals, frame = shown["q"], self.robot, self.problem.goals, super().frame(shown)
        corners = np.hstack([chair_corners(robot.outline, q[None])[0], np.full((4, 1), 0.04)]).tolist()
        turn = np.array([[math.cos(q[2]), -math.sin(q[2])], [math.sin(q[2]), math.cos(q[2])]])

        def placed(point: tuple[float, float, float]) -> list[float]:
            return [*(turn @ point[:2] + q[:2]).tolist(), point[2]]

        frame["capsules"] += [[*placed(each.start), *placed(each.end), each.radius, PURPLE] for each in robot.keep_out]
        frame["lines"] = [{"points": [*corners, corners[0]], "colour": BLUE, "radius": 0.02}]
        hand, closed = np.array(frame["handles"]["hand"]), bool(shown["closed"].ravel()[0])
        while self._reached < len(goals) - 1 and goals[self._reached].met(hand, closed):
            self._reached += 1
        return frame | ({"goal": goals[self._reached].hand_m} if goals else {})


def _wall(wall: HalfPlane) -> list[list[float]]:
    """Corners of an upright rectangle that shows a wall, centred at the wall's point nearest to the origin."""
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
STOPPED = "chair and arm brake or rest despite the stick's command"
USER = "each controller has its own simulated user, who watches the hand and moves the stick"
RECORDED = "the recorded stick does not react to the robot: all controllers get the same"
SENT = "speeds and accelerations are those of the commands"


def _stick_notes(drive: DriveName, reasons: Sequence[str], dt: float, said: str) -> Iterator[NotMet]:
    """One note for each reason: the effect `said`, its duration, and the reason."""
    for reason, ticks in reason_counts(reasons).items():
        yield NotMet(f"{drive} drive: for {ticks * dt:.1f} s {said}: {reason}")


class ArdisSystem(SceneSystem[ArdisProblem, ArdisScene]):
    """A wheelchair with an arm, moved by one stick, for each drive of the file."""

    schema = ArdisProblem
    drawing = "rehab_opt.session.ardis.figures"
    solver_key, rate_key = "run.solver", "run.rate_hz"
    first = (
        "goals_met", "duration", "broken_any", "excess: position", "excess: keep_out", "excess: obstacles", "status",
    )  # fmt: skip
    labels = ("drive", "law")

    def check(self, config: Config) -> tuple[str, ...]:
        """Read the sticks and their commands, build the robot and its controllers."""
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
            inputs = (stick.at(each) or LET_GO for each in moments)
            told = [joystick.step(each.stick, switch=each.switch, gripper=each.gripper) for each in inputs]
            notes += _stick_notes(drive, [each.reason for each in told], dt, IGNORED)
            if not any(each.reason or each.twist.any() for each in told):
                notes.append(NotMet(f"{drive} drive: the stick commands nothing"))
        low = [goal.name for goal in config.problem.goals if goal.hand_m[2] < -goal.within_m]
        return (*notes, *(NotMet(f"goal {name!r} is below the floor") for name in low))

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, ArdisScene]:
        """Each controller with each drive of the file."""
        drives, solver = config.problem.stick.drives, options.get("solver")
        return {(drive, law): ArdisScene(config, solver, drive, law) for drive in drives for law in LAWS}

    def live(self, config: Config, *, options: Mapping[str, str]) -> LiveProblem:
        """Our controller with the first drive and a live stick; options as for `run`."""
        return ArdisScene(config, options.get("solver"), config.problem.stick.drives[0])

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """Metrics by drive and controller; distances to bodies by drive, for our controller only."""
        drives: dict[str, dict[str, Any]] = {}
        for (drive, law), of in numbers.items():
            drives.setdefault(drive, {})[law] = {key: value for key, value in of.items() if key != "clearance"}
        near = {drive: of["clearance"] for (drive, _), of in numbers.items() if "clearance" in of}
        return {"drives": drives, **({"clearance": near} if near else {})}
