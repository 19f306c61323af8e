"""One trial in closed loop: person and robot with the numbers of a problem file, and a law."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.hand_robot import MakesRobots, MujocoHandRobot, OnMujoco, WithoutDelay
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.plant.making import channel_of, ms
from rehab_opt.session.scenario.intention import Intention, Pace
from rehab_opt.session.scenario.laws import ForceLaw
from rehab_opt.session.scenario.outcome import Law, Trial
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.simulated_person import Person, SimulatedPerson
from rehab_opt.workspace.region import Workspace

__all__ = ["Arrival", "Scene", "hand_robot_of", "person_of", "ran", "robot_model_of"]


STABLE = 1 + 1e-6
"""Growth a tick that rounding makes of none."""


def person_of(problem: ScenarioProblem) -> Person:
    """The simulated person's numbers."""
    said = problem.person
    return Person(
        hand_mass=said.hand_mass_kg,
        stiffness=said.stiffness_N_m,
        damping=said.damping_Ns_m,
        persistence=said.persistence_per_s,
        strength=said.strength_N,
        weak_strength=said.weak_strength_N,
        fades_over=1e-3 * said.fades_over_mm,
        passive_stiffness=said.passive_stiffness_N_m,
        passive_damping=said.passive_damping_Ns_m,
        wander=1e-3 * said.wander_mm,
        wander_time=said.wander_s,
        tremor=said.tremor_N,
        tremor_hz=said.tremor_hz,
        spasm_rate=said.spasms_per_s,
        spasm_force=said.spasm_N,
        spasm_time=said.spasm_s,
        aims=said.aims,
        ahead=1e-3 * said.ahead_mm,
    )


def robot_model_of(loaded: ProblemFile[ScenarioProblem]) -> RobotModel:
    """The simulated robot's numbers.

    Raises
    ------
    ProblemFileError : its force loop is unstable with this hand, or a simulation in ticks so long is.
    """
    said, person, rate = loaded.problem.robot, loaded.problem.person, loaded.problem.run.rate_hz
    model = RobotModel(
        mass=said.mass_kg,
        viscous=said.viscous_Ns_m,
        coulomb=said.coulomb_N,
        gain=said.gain,
        integral=said.integral_per_s,
        noise=said.sensor_noise_N,
        motor_limit=said.motor_limit_N,
        lower=(said.lower_m[0], said.lower_m[1]),
        upper=(said.upper_m[0], said.upper_m[1]),
    )
    try:
        model.check(person.hand_mass_kg, dt=1 / rate)
    except ConfigurationError as refused:
        raise ProblemFileError(loaded.file, f"robot.{refused.argument}", refused.value, refused.expected) from refused
    stiff, tough = person.stiffness_N_m, person.damping_Ns_m
    held = (
        (0.0, 0.0),
        (person.passive_stiffness_N_m, 0.0),
        (stiff, tough),
        (stiff + person.passive_stiffness_N_m, tough),
    )
    grows = max(
        model.growth(person.hand_mass_kg, stiffness=k, damping=d + person.passive_damping_Ns_m, dt=1 / rate)
        for k, d in held  # in and out of W_c, with the will saturated and not
    )
    if not grows <= STABLE:
        expected = "a higher rate, or softer robot and person (springs, dampers, viscous_Ns_m, gains; heavier masses)"
        value = f"{rate:g}, at which their simulation grows {grows:.3g}-fold a tick"
        raise ProblemFileError(loaded.file, "run.rate_hz", value, expected)
    return model


def hand_robot_of(loaded: ProblemFile[ScenarioProblem]) -> MakesRobots:
    """The simulated robot on the file's plant; raises as `robot_model_of`."""
    model, table = robot_model_of(loaded), loaded.problem.plant
    if table.kind == "ideal":
        return WithoutDelay(model)
    channel = channel_of(table, table.position_noise_m, table.position_resolution_m)
    return OnMujoco(model, channel, ms(table.force_lag_ms), ms(table.physics_step_ms), table.seed)


CALM = 0.02
"""[m/s] A hand that is slower than this has arrived."""


class Arrival(NamedTuple):
    """When a reach is over: the hand has been within so far [m] of its goal, and calm, for so long [s]."""

    within: float
    seconds: float


class Scene(NamedTuple):
    """What the trials of a scenario share."""

    comfortable: Workspace
    person: Person
    robot: MakesRobots
    intention: Intention
    arrival: Arrival | None
    """None where the time says when the trial is over."""
    dt: float


def ran(scene: Scene, law: ForceLaw, *, name: Law, number: int, seed: int) -> Trial:
    """One trial from rest at the intention's first place; the seed decides the person's moods and the sensor's."""
    intention, dt, arrival = scene.intention, scene.dt, scene.arrival
    pace = Pace(intention, scene.person.aims, ahead=scene.person.ahead)
    ticks = pace.ticks
    start = tuple(intention.places[0].tolist())
    person = SimulatedPerson(scene.person, scene.comfortable, dt=dt, ticks=ticks, seed=seed)
    robot = scene.robot.robot(
        hand_mass=scene.person.hand_mass,
        start=start,
        dt=dt,
        rng=np.random.default_rng((seed, 1)),
        ticks=ticks,
    )
    meant = np.hstack((intention.places, intention.velocities)).tolist()
    goals, goal_x, goal_y = intention.goal.tolist(), 0.0, 0.0
    meant_at: list[int] = []
    calm, needed = 0, math.inf if arrival is None else math.ceil(arrival.seconds / dt)
    within = 0.0 if arrival is None else arrival.within
    law.start(number)
    aimed, rows, marks = -1, [], []
    shown: list[tuple[float, ...]] = []
    for _ in range(ticks):
        now, goes_on = pace.meant(robot.x, robot.y)
        meant_at.append(now)
        if goals[now] != aimed:
            aimed = goals[now]
            law.aim(aimed)
            goal_x, goal_y = intention.goals[aimed].tolist()
        x, y, vx, vy = robot.x, robot.y, robot.vx, robot.vy
        wanted, force, status, yielded, left = law.answer(*robot.seen)
        to_x, to_y, to_vx, to_vy = meant[now]
        push = person.force(x, y, vx, vy, to_x, to_y, *((to_vx, to_vy) if goes_on else (0.0, 0.0)))
        if isinstance(robot, MujocoHandRobot):
            shown.append((*robot.seen, *robot.acting))
        robot.step(*force, *push)
        rows.append((x, y, vx, vy, *wanted, *force, robot.measured_x, robot.measured_y, left, person.beyond))
        marks.append((status, yielded))
        near = math.hypot(robot.x - goal_x, robot.y - goal_y) <= within and math.hypot(robot.vx, robot.vy) <= CALM
        calm = calm + 1 if near else 0
        if calm >= needed or pace.over:
            break
    count, at = len(rows), np.array(meant_at)
    table, flags = np.array(rows), np.array(marks, dtype=np.uint8)
    time = np.asarray(np.arange(count) * dt, dtype=np.float64)
    goal = np.where(intention.active[at, None], intention.goals[intention.goal[at]], np.nan)
    return Trial(
        law=name,
        number=number,
        time=time,
        position=table[:, 0:2],
        velocity=table[:, 2:4],
        intended=intention.places[at],
        wanted=table[:, 4:6],
        commanded=table[:, 6:8],
        measured=table[:, 8:10],
        inside=table[:, 11] <= 0.0,
        status=flags[:, 0],
        yielded=flags[:, 1],
        energy_left=table[:, 10],
        goal=goal,
        ended="late" if arrival is not None and calm < needed else "done",
        helper=law.partner(),
        seen=np.array(shown)[:, 0:2] if shown else None,
        acting=np.array(shown)[:, 2:4] if shown else None,
    )
