"""Helper and participant of a problem file as a controller of the loop, with a simulated helper, and their measures."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.bilateral_sides import HelperSide, ParticipantSide
from rehab_opt.control.command import Command
from rehab_opt.plants.hand_robot import MakesRobots
from rehab_opt.plants.intention import Intention, traced
from rehab_opt.plants.simulated_person import Person, SimulatedPerson
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.scenario.laws import ForceLaw, bounds_of, bounds_refusals
from rehab_opt.session.scenario.loop import hand_robot_of
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.trials import HELPER
from rehab_opt.session.trace import Trace
from rehab_opt.workspace.region import Workspace

__all__ = ["pair_measures", "pair_of", "sides_of", "together_of"]


class Helper(NamedTuple):
    """The helper, their robot, and their intended motion in their workspace."""

    person: Person
    robot: MakesRobots
    workspace: Workspace
    intention: Intention


class Together(ForceLaw):
    """The participant's side of a `Bilateral` pair; the helper's hand and robot are simulated in the same loop.

    Parameters
    ----------
    both : the pair. helper : the other end; the helper restarts at the end of the intended motion.
    seed : seed of the helper's variability; a trial's number is added.
    """

    def __init__(self, both: Bilateral, helper: Helper, *, seed: int) -> None:
        self._both, self._helper, self._seed = both, helper, seed
        self.notes = both.participant.force.notes

    def start(self, number: int) -> None:
        """Start a new trial: both sides at rest, no messages under way."""
        meant = self._helper.intention
        self._both.reset()
        self._meant = np.hstack((meant.places, meant.velocities)).tolist()
        x, y = meant.places[0].tolist()
        self._begin(number, (x, y))

    def _begin(self, number: int, start: tuple[float, float]) -> None:
        """Put the helper at rest at a position, with the noise of one trial."""
        helper, dt, ticks, seed = self._helper, self._both.dt, len(self._meant), (self._seed + number, 2)
        self._person = SimulatedPerson(helper.person, helper.workspace, dt=dt, ticks=ticks, seed=seed)
        rng = np.random.default_rng((*seed, 1))
        self._robot = helper.robot.robot(hand_mass=helper.person.hand_mass, start=start, dt=dt, rng=rng, ticks=ticks)
        self._number, self._now = number, 0
        self._rows: list[tuple[float, ...]] = []

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The participant's force; the helper moves by a tick, or rests while the participant is not enabled."""
        if len(self._rows) == len(self._meant):
            self._begin(self._number + 1, (self._robot.x, self._robot.y))
        both, robot = self._both, self._robot
        at_x, at_y, vx, vy = robot.x, robot.y, robot.vx, robot.vy
        felt, drawn = both.step(robot.seen, (x, y), enable=enable)
        felt_x, felt_y = felt.value.tolist()
        push = self._person.force(at_x, at_y, vx, vy, *self._means(enable))
        robot.step(felt_x, felt_y, *push)
        self._rows.append((at_x, at_y, felt_x, felt_y, both.helper.force.energy_left))
        self.along = (at_x, at_y, felt_x, felt_y)
        self.desired_force, self.energy_left = both.participant.force.desired_force, both.participant.force.energy_left
        return drawn

    def _means(self, enable: object) -> list[float]:
        """Intended position [m] and velocity [m/s] of the helper's hand."""
        if not enable:
            return [self._robot.x, self._robot.y, 0.0, 0.0]
        if self.led is not None:
            return [*self.led, 0.0, 0.0]
        meant: list[float] = self._meant[self._now]
        self._now += 1
        return meant

    def partner(self) -> dict[str, Array]:
        """`HELPER` of each tick."""
        table = np.array(self._rows)
        meant = self._helper.intention.places[: len(table)]
        return dict(zip(HELPER, (table[:, 0:2], table[:, 2:4], table[:, 4], meant), strict=True))


def pair_of(
    config: ProblemFile[ScenarioProblem], context: Precomputed, *, delay: float, solver: str | None
) -> Together:
    """The pair with a mapped path and a `delay` [s].

    Raises
    ------
    ProblemFileError : a value of the file is not valid.
    ConfigurationError : `solver` is not valid.
    """
    return together_of(Bilateral(*sides_of(config, context, solver=solver), delay=delay), config, context)


def sides_of(
    config: ProblemFile[ScenarioProblem], context: Precomputed, *, solver: str | None, backup: str | None = None
) -> tuple[HelperSide, ParticipantSide]:
    """Both sides of a mapped path; raises as `pair_of`."""
    problem, said, helper = config.problem, config.problem.assistance, config.problem.helper
    assert context.workspace_map is not None  # the schema refuses a pair without a map
    bounds = bounds_of(problem, solver=solver)
    bounds["backup"] = backup
    with bounds_refusals(config, solver=solver, section="helper or assistance"):
        return (
            HelperSide(
                context.workspace_map,
                **helper.arguments("hand_damping_Ns_m", "exchange_per_s", hand_damping_Ns_m="damping"),
                force_limit=said.force_limit_N,
                **bounds,
            ),
            ParticipantSide(
                context.workspace_map,
                comfortable=context.comfortable,
                **helper.arguments("stiffness_N_m", "damping_Ns_m", "exchange_per_s"),
                force_limit=said.force_limit_N,
                **bounds,
            ),
        )


def together_of(both: Bilateral, config: ProblemFile[ScenarioProblem], context: Precomputed) -> Together:
    """The pair as a controller, with a simulated helper.

    Raises
    ------
    ProblemFileError : a value of the file is not valid.
    """
    task, helper, dt = config.problem.task, config.problem.helper, both.dt
    assert context.demonstrated is not None
    meant = traced(context.demonstrated, seconds=task.movement_s, rest=task.rest_s, dt=dt)
    healthy = Person(wander=1e-3 * helper.wander_mm, tremor=0.0, spasm_rate=0.0)
    robot = hand_robot_of(config)
    with refused_as(config.file, "robot.{}, with the helper's hand".format):
        robot.model.check(healthy.hand_mass, dt=dt)
    return Together(both, Helper(healthy, robot, context.reachable, meant), seed=task.seed)


def pair_measures(trial: Trace) -> dict[str, Any]:
    """Measures of the helper's motion and force, and the largest energy [J] that both hands together had drawn."""
    if "_helper_intended" not in trial:
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
