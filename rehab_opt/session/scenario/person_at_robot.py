"""A robot with the simulated person's hand on its handle, as a plant: forces in, places out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.plants.hand_robot import MakesRobots
from rehab_opt.plants.plant import Measurement, Truth
from rehab_opt.session.scenario.simulated_person import Person, SimulatedPerson
from rehab_opt.workspace.region import Workspace

__all__ = ["PersonAtRobot"]

Array = NDArray[np.float64]

LONGEST = 120.0
"""[s] after which robot and person begin anew where they are, at rest: their moods and noise are drawn beforehand."""


class PersonAtRobot:
    """The person and robot of a scenario's trials; a `Plant` whose commands are forces (2,) [N].

    Attributes
    ----------
    aim : (x, y, vx, vy) [m, m/s] where the hand is meant to be, and how fast; None: nowhere, the person lets it rest.
    exerted : (2,) [N] by the person in the last tick.

    Parameters
    ----------
    person, comfortable : see `SimulatedPerson`. robot : makes robots. dt : [s] of a tick. seed : of moods and noise.
    """

    def __init__(self, person: Person, comfortable: Workspace, robot: MakesRobots, *, dt: float, seed: int) -> None:
        self.dt, self.person, self._comfortable, self._kind, self._seed = dt, person, comfortable, robot, seed
        self._most = math.ceil(LONGEST / dt)
        self.aim: tuple[float, float, float, float] | None = None
        self.exerted: Array = np.zeros(2)
        self._time = 0.0
        self.reset((0.0, 0.0))

    @property
    def measured(self) -> Measurement:
        """Where the controller sees the hand; the speed is the true one, which no law of a scenario is given."""
        robot = self._robot
        return Measurement(self._time, np.array(robot.seen), np.array((robot.vx, robot.vy)), self._felt)

    @property
    def truth(self) -> Truth:
        """Where the hand is."""
        robot = self._robot
        return Truth(
            self._time, np.array((robot.x, robot.y)), np.array((robot.vx, robot.vy)), np.zeros(2), self._felt
        )  # fmt: skip

    def reset(self, position: ArrayLike) -> Measurement:
        """At rest at `position` (2,) [m]; the clock at zero."""
        self._time = 0.0
        x, y = np.asarray(position, dtype=np.float64).tolist()
        self._begin((x, y))
        return self.measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """One tick under the robot's force (2,) [N], the person's, and a push (2,) [N] besides."""
        if self._left == 0:
            self._begin((self._robot.x, self._robot.y))
        self._left -= 1
        robot, force = self._robot, np.asarray(command, dtype=np.float64)
        to = (robot.x, robot.y, 0.0, 0.0) if self.aim is None else self.aim
        will_x, will_y = self._moods.force(robot.x, robot.y, robot.vx, robot.vy, *to)
        if push is not None:
            more_x, more_y = np.asarray(push, dtype=np.float64)[:2].tolist()
            will_x, will_y = will_x + more_x, will_y + more_y
        robot.step(float(force[0]), float(force[1]), will_x, will_y)
        self.exerted, self._time = np.array((will_x, will_y)), self._time + self.dt
        return self.measured

    @property
    def _felt(self) -> Array:
        return np.array((self._robot.measured_x, self._robot.measured_y))

    def _begin(self, start: tuple[float, float]) -> None:
        self._left = self._most
        self._seed += 1
        self._moods = SimulatedPerson(
            self.person, self._comfortable, dt=self.dt, ticks=self._most, seed=self._seed
        )  # fmt: skip
        self._robot = self._kind.robot(
            hand_mass=self.person.hand_mass, start=start, dt=self.dt, rng=np.random.default_rng((self._seed, 1)),
            ticks=self._most,
        )  # fmt: skip
