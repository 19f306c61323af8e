"""One trial in closed loop: the person and robot of a problem file with one controller."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.command import Command
from rehab_opt.control.reasons import NUMBER, reason_text
from rehab_opt.errors import ProblemFileError
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.hand_robot import MakesRobots, OnMujoco, WithoutDelay
from rehab_opt.plants.intention import Intention, Pace
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.plants.simulated_person import Person, PersonAtRobot
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveControl, LiveInputs
from rehab_opt.session.plant import channel_of, ms
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.scenario.laws import ForceLaw
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.trials import trial_trace
from rehab_opt.session.simulation import simulate
from rehab_opt.session.trace import Trace
from rehab_opt.workspace.region import Workspace

STOOD = reason_text(NUMBER["HAND_STANDS"], ())
STABLE = 1 + 1e-6
"""Largest growth factor of the simulation in a tick that counts as stable; the excess over 1 is rounding."""


def person_of(problem: ScenarioProblem) -> Person:
    """The parameters of the simulated person."""
    own = {"wander_s": "wander_time", "spasms_per_s": "spasm_rate", "spasm_N": "spasm_force", "spasm_s": "spasm_time"}
    return Person(**problem.person.arguments(**own))


def robot_model_of(config: ProblemFile[ScenarioProblem]) -> RobotModel:
    """The parameters of the simulated robot."""
    person, rate = config.problem.person, config.problem.run.rate_hz
    model = RobotModel(**config.problem.robot.arguments(sensor_noise_N="noise"))
    with refused_as(config.file, "robot.{}".format):
        model.check(person.hand_mass_kg, dt=1 / rate)
    stiff, tough = person.stiffness_N_m, person.damping_Ns_m
    held = (
        (0.0, 0.0),
        (person.passive_stiffness_N_m, 0.0),
        (stiff, tough),
        (stiff + person.passive_stiffness_N_m, tough),
    )
    grows = max(
        model.growth(person.hand_mass_kg, stiffness=k, damping=d + person.passive_damping_Ns_m, dt=1 / rate)
        for k, d in held  # inside and outside W_c, with and without a saturated voluntary force
    )
    if not grows <= STABLE:
        expected = "a higher rate, or softer robot and person (springs, dampers, viscous_Ns_m, gains; heavier masses)"
        value = f"{rate:g}, at which their simulation grows {grows:.3g}-fold a tick"
        raise ProblemFileError(config.file, "run.rate_hz", value, expected)
    return model


def hand_robot_of(config: ProblemFile[ScenarioProblem]) -> MakesRobots:
    """The simulated robot on the file's plant; raises as `robot_model_of`."""
    model, table = robot_model_of(config), config.problem.plant
    if table.kind == "ideal":
        return WithoutDelay(model)
    return OnMujoco(model, channel_of(table), ms(table.force_lag_ms), ms(table.physics_step_ms), table.seed)


CALM, REST = 0.02, 0.5
"""[m/s, s] A hand that is slower than `CALM` for the time `REST` has arrived."""


class Scene(NamedTuple):
    """The simulated person, robot and intention, which all trials of a scenario share."""

    comfortable: Workspace
    person: Person
    robot: MakesRobots
    intention: Intention
    within: float | None
    """[m] A reach ends when the hand has rested within this distance of its goal; None if trials end by time."""
    dt: float

    @property
    def pace(self) -> Pace:
        """The person's progress through the intention, for a new trial."""
        return Pace(self.intention, self.person.aims, ahead=self.person.ahead)


LONGEST = 120.0
"""[s] In repeated trials, the time after which person and robot restart at their current positions."""
HELD = LiveInputs(enable=True)


class Helping(LiveControl):
    """A controller and a simulated person, who intends the file's motion or the point that the live user selects.

    Parameters
    ----------
    law : controller, which is started for the trial `number`. scene : person, robot and intention of all trials.
    seed : seed of the person's variability and of the sensor noise.
    endless : after a trial the next one starts at the hand's current position.
    plant : replaces this person and robot, for example when a log is replayed.

    Attributes
    ----------
    now : current tick of the intention.
    """

    def __init__(
        self, law: ForceLaw, scene: Scene, *, number: int, seed: int, endless: bool, plant: Plant | None = None
    ) -> None:
        intention = scene.intention
        self.law, self.pace, self.now = law, scene.pace, 0
        self._scene, self._endless, self._current_goal, self._force = scene, endless, -1, np.zeros(2)
        self._meant: list[tuple[float, float, float, float]] = list(
            zip(*intention.places.T.tolist(), *intention.velocities.T.tolist(), strict=True)
        )
        self._goals: list[int] = intention.goal.tolist()
        ticks = math.ceil(LONGEST / scene.dt) if endless else self.pace.ticks
        self.person = PersonAtRobot(
            scene.person, scene.comfortable, scene.robot, dt=scene.dt, seed=seed, ticks=ticks
        )  # fmt: skip
        super().__init__(TouchedPlant(self.person) if plant is None else plant, intention.places[0])
        law.start(number)

    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The controller's command; the person intends a motion if enabled, or if the live user selects a point."""
        person = self.person
        person.target = (*inputs.target[:2], 0.0, 0.0) if inputs.dragged else None
        self.law.led = inputs.helper[:2] if all(map(math.isfinite, inputs.helper)) else None
        if inputs.enable:
            if self._endless and self.pace.over:
                self.pace, self._current_goal = self._scene.pace, -1
            now, goes_on = self.pace.meant(*person.hand[:2])
            if not inputs.dragged:
                person.target = self._meant[now] if goes_on else (*self._meant[now][:2], 0.0, 0.0)
            if self._goals[now] != self._current_goal:
                self._current_goal = self._goals[now]
                self.law.set_goal(self._current_goal)
            self.now = now
        command = self.law.command(*seen.position.tolist(), enable=inputs.enable, stamp=self.stamp(seen))
        self._force = command.value
        return command

    def shown(self) -> dict[str, ArrayLike]:
        """Hand, intended position and forces."""
        return {
            "hand": self.person.hand[:2], "meant": self._meant[self.now][:2], "force": self._force,
            "desired": self.law.desired_force, "exerted": self.person.exerted, "energy": self.law.energy_left,
            "along": self.law.along[:4],
        }  # fmt: skip


def simulate_trial(scene: Scene, law: ForceLaw, *, number: int, seed: int) -> Trace:
    """One trial from rest at the intention's first position; the seed sets the noise of person and sensor."""
    intention, within = scene.intention, scene.within
    control = Helping(law, scene, number=number, seed=seed, endless=False)
    needed, calm = math.ceil(REST / scene.dt), 0

    def arrived() -> bool:
        """Whether, after a tick, the hand has been at its goal and at rest for long enough."""
        nonlocal calm
        if within is None:
            return False
        x, y, vx, vy = control.person.hand
        goal_x, goal_y = intention.goals[intention.goal[control.now]].tolist()
        near = math.hypot(x - goal_x, y - goal_y) <= within and math.hypot(vx, vy) <= CALM
        calm = calm + 1 if near else 0
        return calm >= needed

    found = simulate(
        control,
        lambda k: None if k and (arrived() or control.pace.over) else HELD,
        ticks=control.pace.ticks,
        also=lambda _, command: {
            "now": control.now, "desired": tuple(law.desired_force), "energy": law.energy_left,
            "gave": command.relaxed._value_, "along": law.along,
        },
    )  # fmt: skip
    at, hand = found["now"], found["joint"]
    if len(at) == control.pace.ticks:
        arrived()
    columns = {
        "t_s": found["t_s"],
        "_hand": hand,
        "velocity": found["velocity"],
        "intended": intention.places[at],
        "force_desired": found["desired"],
        "force_commanded": found["command"],
        "force_measured": found["_force"],
        "inside": np.asarray(scene.comfortable.distance(hand)) <= 0.0,
        "goal": np.where(intention.active[at, None], intention.goals[intention.goal[at]], np.nan),
        "energy_left_J": found["energy"],
        "status": found["status"],
        "_relaxed": found["gave"].astype(np.uint8),
        "_let_go": found["reason"] == STOOD,
    }
    if np.isfinite(law.along[0]):
        place, force, energy, meant = np.split(found["along"], (2, 4, 5), axis=1)
        columns |= {"helper": place, "helper_force": force, "helper_energy_left_J": energy[:, 0]}
        columns["_helper_intended"] = meant
    if isinstance(scene.robot, OnMujoco):
        columns |= {"_seen": found["measured"], "_acting": found["_effort"]}
    return trial_trace(columns, ended="late" if within is not None and calm < needed else "done")
