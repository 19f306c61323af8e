"""A helper and a participant as a controller of the closed loop, with a simulated helper, and measures of both."""

from __future__ import annotations

from typing import Any

import numpy as np

from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.bilateral_sides import HelperSide, ParticipantSide
from rehab_opt.control.command import Command
from rehab_opt.plants.hand_robot import MakesRobots
from rehab_opt.plants.intention import traced
from rehab_opt.plants.simulated_person import Person, SimulatedPerson
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.scenario.laws import ForceLaw, bounds_of, bounds_refusals
from rehab_opt.session.scenario.loop import hand_robot_of
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.trace import Trace


class Together(ForceLaw):
    """The participant's side of a `Bilateral` pair; the helper's hand and robot are simulated in the same loop.

    Parameters
    ----------
    both : the pair. context : workspaces and task of the file; the helper repeats the intended motion.
    person, makes : parameters of the helper, and the factory of the helper's robot.
    """

    def __init__(self, both: Bilateral, context: Precomputed, person: Person, makes: MakesRobots) -> None:
        self._both, self._workspace, self._healthy, self._makes = both, context.reachable, person, makes
        self._seed, task = context.problem.task.seed, context.problem.task
        assert context.demonstrated is not None  # the schema refuses a pair without a map
        meant = traced(context.demonstrated, seconds=task.movement_s, rest=task.rest_s, dt=both.dt)
        self._meant = np.hstack((meant.places, meant.velocities)).tolist()
        self.notes = both.participant.force.notes

    def start(self, number: int) -> None:
        """Start a new trial: both sides at rest, no messages under way."""
        self._both.reset()
        x, y, *_ = self._meant[0]
        self._begin(number, (x, y))

    def _begin(self, number: int, start: tuple[float, float]) -> None:
        person, dt, ticks, seed = self._healthy, self._both.dt, len(self._meant), (self._seed + number, 2)
        self._person = SimulatedPerson(person, self._workspace, dt=dt, ticks=ticks, seed=seed)
        rng = np.random.default_rng((*seed, 1))
        self._robot = self._makes.robot(hand_mass=person.hand_mass, start=start, dt=dt, rng=rng, ticks=ticks)
        self._number, self._now, self._ticks = number, 0, 0

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The participant's force; the helper moves by a tick, or rests while the participant is not enabled."""
        if self._ticks == len(self._meant):
            self._begin(self._number + 1, (self._robot.x, self._robot.y))
        self._ticks += 1
        both, robot = self._both, self._robot
        at_x, at_y, vx, vy = robot.x, robot.y, robot.vx, robot.vy
        felt, drawn = both.step(robot.seen, (x, y), enable=enable)
        felt_x, felt_y = felt.value.tolist()
        meant = self._means(enable)
        robot.step(felt_x, felt_y, *self._person.force(at_x, at_y, vx, vy, *meant))
        self.along = (at_x, at_y, felt_x, felt_y, both.helper.force.energy_left, *meant[:2])
        self.desired_force, self.energy_left = both.participant.force.desired_force, both.participant.force.energy_left
        return drawn

    def _means(self, enable: object) -> list[float]:
        """Intended position [m] and velocity [m/s] of the helper's hand, as [x, y, vx, vy]."""
        if not enable:
            return [self._robot.x, self._robot.y, 0.0, 0.0]
        if self.led is not None:
            return [*self.led, 0.0, 0.0]
        meant: list[float] = self._meant[self._now]
        self._now += 1
        return meant


def sides_of(
    context: Precomputed, *, solver: str | None, backup: str | None = None
) -> tuple[HelperSide, ParticipantSide]:
    """The helper's and the participant's side of the pair, for a mapped path."""
    helper, shared = context.problem.helper, context.workspace_map
    assert shared is not None  # the schema refuses a pair without a map
    bounds = bounds_of(context.problem, solver=solver, backup=backup)
    own = helper.arguments("hand_damping_Ns_m", "exchange_per_s", hand_damping_Ns_m="damping")
    other = helper.arguments("stiffness_N_m", "damping_Ns_m", "exchange_per_s")
    with bounds_refusals(context.config, solver=solver, section="helper or assistance"):
        participant = ParticipantSide(shared, comfortable=context.comfortable, **other, **bounds)
        return HelperSide(shared, **own, **bounds), participant


def together_of(both: Bilateral, context: Precomputed) -> Together:
    """The pair as a controller, with a simulated helper."""
    healthy = Person(wander=1e-3 * context.problem.helper.wander_mm, tremor=0.0, spasm_rate=0.0)
    robot = hand_robot_of(context.config)
    with refused_as(context.config.file, "robot.{}, with the helper's hand".format):
        robot.model.check(healthy.hand_mass, dt=both.dt)
    return Together(both, context, healthy, robot)


def pair_measures(trial: Trace) -> dict[str, Any]:
    """Measures of the helper's motion and force, and the largest energy [J] that both hands together had drawn."""
    if "helper" not in trial:
        return {}
    felt = np.linalg.norm(trial["helper_force"], axis=1)
    off = np.linalg.norm(trial["helper"] - trial["_helper_intended"], axis=1)
    drawn = sum(
        np.cumsum((force[:-1] * np.diff(position, axis=0)).sum(axis=1))
        for force, position in ((trial["force_commanded"], trial["_hand"]), (trial["helper_force"], trial["helper"]))
    )
    return {
        "helper_force_mean_N": float(felt.mean()),
        "helper_force_max_N": float(felt.max()),
        "helper_deviation_mean_m": float(off.mean()),
        "pair_energy_drawn_max_J": float(max(0.0, np.max(drawn))),
        "pair_energy_left_min_J": float(min(trial["helper_energy_left_J"].min(), trial["energy_left_J"].min())),
    }
