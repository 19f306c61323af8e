"""A planar robot that holds a hand: what a loop of forces needs of it, and the one in MuJoCo."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from rehab_opt.plants.arm_model import point_mass_model
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.drives import HandForceLoop
from rehab_opt.plants.force_robot import ForceRobot, RobotModel
from rehab_opt.plants.mujoco_arm import MujocoArm

__all__ = ["HandRobot", "MakesRobots", "MujocoHandRobot", "OnMujoco", "WithoutDelay"]


class HandRobot(Protocol):
    """A robot with a hand on its handle, from tick to tick; x, y [m] and vx, vy [m/s] are the hand's true state."""

    x: float
    y: float
    vx: float
    vy: float
    measured_x: float
    measured_y: float
    """[N] on the hand, by the sensor, in the last tick."""

    @property
    def seen(self) -> tuple[float, float]:
        """[m] where the controller sees the hand."""
        ...

    @property
    def acting(self) -> tuple[float, float]:
        """[N] of the motors in the last tick, or at its end where the physics has smaller steps."""
        ...

    def step(self, force_x: float, force_y: float, person_x: float, person_y: float) -> None:
        """One tick under the commanded force [N], with a person who pushes the handle with person_x, person_y [N]."""
        ...


class MakesRobots(Protocol):
    """Robots of one kind, each at rest at its start."""

    @property
    def model(self) -> RobotModel:
        """Its numbers."""
        ...

    def robot(
        self, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator, ticks: int
    ) -> HandRobot:
        """One with a hand of `hand_mass` [kg] at `start` [m], for at most `ticks` ticks of `dt` [s]."""
        ...


class WithoutDelay(NamedTuple):
    """`ForceRobot`: its motors give what its loop asks for, and the hand is seen where it is."""

    model: RobotModel

    def robot(
        self, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator, ticks: int
    ) -> HandRobot:
        """A `ForceRobot`."""
        return ForceRobot(self.model, hand_mass=hand_mass, start=start, dt=dt, rng=rng, ticks=ticks)


class OnMujoco(NamedTuple):
    """`MujocoHandRobot`: late, noisy, and with a lag of its motors' force."""

    model: RobotModel
    channel: Channel
    lag: float
    """[s] time constant of the force."""
    physics_step: float
    """[s]"""
    seed: int

    def robot(
        self, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator, ticks: int
    ) -> HandRobot:
        """A `MujocoHandRobot`; its noise comes of `seed` and of the trial's own generator."""
        return MujocoHandRobot(self, hand_mass=hand_mass, start=start, dt=dt, rng=rng)


class MujocoHandRobot:
    """The robot of `RobotModel` as a mass on two axes in MuJoCo, its force loop in steps of the physics.

    Dry friction acts on each axis apart; the mechanical stops are MuJoCo's, a little soft.

    Parameters
    ----------
    kind : numbers of the robot and of the way to it.
    hand_mass, start, dt, rng : see `MakesRobots`.
    """

    def __init__(
        self, kind: OnMujoco, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator
    ) -> None:
        model = kind.model
        own = np.random.default_rng([kind.seed, int(rng.integers(2**31))])
        self._drive = HandForceLoop(
            model.gain, model.integral, model.motor_limit, held_mass=hand_mass, lag=kind.lag, noise=model.noise, rng=own
        )
        self._plant = MujocoArm(
            point_mass_model(
                model.mass + hand_mass, viscous=model.viscous, coulomb=model.coulomb, stops=(model.lower, model.upper)
            ),
            dt=dt,
            drive=self._drive,
            channel=kind.channel,
            seed=own,
            physics_step=kind.physics_step,
        )
        self._plant.reset(start)
        self._show()

    @property
    def seen(self) -> tuple[float, float]:
        """[m] where the controller sees the hand."""
        x, y = self._plant.measured.position.tolist()
        return x, y

    @property
    def acting(self) -> tuple[float, float]:
        """[N] of the motors at the end of the last tick."""
        x, y = self._drive.acting.tolist()
        return x, y

    def step(self, force_x: float, force_y: float, person_x: float, person_y: float) -> None:
        """One tick under the commanded force [N], with a person who pushes the handle with person_x, person_y [N]."""
        self._plant.step((force_x, force_y), (person_x, person_y, 0.0))
        self._show()

    def _show(self) -> None:
        truth = self._plant.truth
        self.x, self.y = truth.position.tolist()
        self.vx, self.vy = truth.velocity.tolist()
        self.measured_x, self.measured_y = self._drive.measured.tolist()
