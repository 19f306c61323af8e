"""A simulated helper who does the task in the whole workspace while the participant's hand is drawn along."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rehab_opt.control.bilateral import Bilateral
from rehab_opt.plants.hand_robot import MakesRobots
from rehab_opt.session.scenario.intention import Intention
from rehab_opt.session.scenario.laws import INDEX, Answer, ForceLaw
from rehab_opt.session.scenario.simulated_person import Person, SimulatedPerson
from rehab_opt.session.scenario.trial import HelperTrace
from rehab_opt.workspace.region import Workspace

__all__ = ["Helper", "Together"]


class Helper(NamedTuple):
    """Who helps, with which robot, and what they mean to do in their workspace."""

    person: Person
    robot: MakesRobots
    workspace: Workspace
    intention: Intention


class Together(ForceLaw):
    """The participant's side of a `Bilateral` pair; the helper's hand and robot are simulated along with it.

    Parameters
    ----------
    both : the pair. helper : the other end. seed : of the helper's moods, to which a trial's number is added.
    """

    def __init__(self, both: Bilateral, helper: Helper, *, seed: int) -> None:
        self._both, self._helper, self._seed = both, helper, seed
        self.notes = both.participant.force.notes

    def start(self, number: int) -> None:
        """A new trial: both at rest, nothing under way."""
        helper, dt = self._helper, self._both.dt
        meant = helper.intention
        ticks, seed = len(meant.places), (self._seed + number, 2)
        self._both.reset()
        self._person = SimulatedPerson(helper.person, helper.workspace, dt=dt, ticks=ticks, seed=seed)
        x, y = meant.places[0].tolist()
        rng = np.random.default_rng((*seed, 1))
        self._robot = helper.robot.robot(hand_mass=helper.person.hand_mass, start=(x, y), dt=dt, rng=rng, ticks=ticks)
        self._meant = np.hstack((meant.places, meant.velocities)).tolist()
        self._rows: list[tuple[float, ...]] = []

    def answer(self, x: float, y: float) -> Answer:
        """The participant's force; the helper moves on by a tick."""
        both, robot = self._both, self._robot
        at_x, at_y, vx, vy = robot.x, robot.y, robot.vx, robot.vy
        felt, drawn = both.step(robot.seen, (x, y))
        felt_x, felt_y = felt.value.tolist()
        push = self._person.force(at_x, at_y, vx, vy, *self._meant[len(self._rows)])
        robot.step(felt_x, felt_y, *push)
        self._rows.append((at_x, at_y, felt_x, felt_y, both.helper.force.energy_left))
        force_x, force_y = drawn.value.tolist()
        side = both.participant.force
        return Answer(side.wanted, (force_x, force_y), INDEX[drawn.status], drawn.yielded._value_, side.energy_left)

    def partner(self) -> HelperTrace:
        """What the helper did, tick by tick."""
        table = np.array(self._rows)
        meant = self._helper.intention.places[: len(table)]
        return HelperTrace(table[:, 0:2], meant, table[:, 2:4], table[:, 4])
