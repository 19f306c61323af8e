"""One trial in closed loop: person, robot with its force loop, and a law."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rehab_opt.plants.hand_robot import MakesRobots, MujocoHandRobot
from rehab_opt.session.scenario.intention import Intention
from rehab_opt.session.scenario.laws import ForceLaw
from rehab_opt.session.scenario.pace import Pace
from rehab_opt.session.scenario.simulated_person import Person, SimulatedPerson
from rehab_opt.session.scenario.trial import Law, Trial
from rehab_opt.workspace.region import Workspace

__all__ = ["Arrival", "Scene", "ran"]

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
