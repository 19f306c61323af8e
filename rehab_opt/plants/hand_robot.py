"""A planar robot with a hand on its handle: the interface, and a simulation in MuJoCo."""

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
    """A robot with a hand on its handle; x, y [m] and vx, vy [m/s] are the hand's true state."""

    x: float
    y: float
    vx: float
    vy: float
    measured_x: float
    measured_y: float
    """Measured force (measured_x, measured_y) [N] on the hand in the last tick."""

    @property
    def seen(self) -> tuple[float, float]:
        """Measured position (x, y) [m] of the hand, the controller's input."""
        ...

    @property
    def acting(self) -> tuple[float, float]:
        """Motor force (x, y) [N] at the end of the last tick."""
        ...

    def step(self, force_x: float, force_y: float, person_x: float, person_y: float) -> None:
        """Simulate one tick with the commanded force and the person's force person_x, person_y on the handle [N]."""
        ...


class MakesRobots(Protocol):
    """Factory that makes robots with the same parameters."""

    @property
    def model(self) -> RobotModel:
        """Parameters of the robot."""
        ...

    def robot(
        self, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator, ticks: int
    ) -> HandRobot:
        """Make a robot at rest with a hand of `hand_mass` [kg] at `start` [m], for at most `ticks` ticks of `dt` [s].

        `rng` is the random generator of the sensor noise.
        """
        ...


class WithoutDelay(NamedTuple):
    """Factory of `ForceRobot`: the motors have no lag, and the measured position is the true one."""

    model: RobotModel

    def robot(
        self, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator, ticks: int
    ) -> HandRobot:
        """Make a `ForceRobot`."""
        return ForceRobot(self.model, hand_mass=hand_mass, start=start, dt=dt, rng=rng, ticks=ticks)


class OnMujoco(NamedTuple):
    """Factory of `MujocoHandRobot`, which has delays, noise, and a lag of the motor force."""

    model: RobotModel
    channel: Channel
    lag: float
    """Time constant [s] of the motor force."""
    physics_step: float
    """Largest duration [s] of a physics step."""
    seed: int

    def robot(
        self, *, hand_mass: float, start: tuple[float, float], dt: float, rng: np.random.Generator, ticks: int
    ) -> HandRobot:
        """Make a `MujocoHandRobot`; its noise depends on `seed` and on the random generator `rng`."""
        return MujocoHandRobot(self, hand_mass=hand_mass, start=start, dt=dt, rng=rng)


class MujocoHandRobot:
    """The robot of a `RobotModel` as a mass on two axes in MuJoCo; its force loop runs in each physics step.

    Dry friction acts on each axis separately. The mechanical stops are slightly soft, as MuJoCo simulates them.

    Parameters
    ----------
    kind : parameters of the robot and of the channel.
    hand_mass, start, dt, rng : as in `MakesRobots.robot`.
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
        """Measured position (x, y) [m] of the hand, the controller's input."""
        x, y = self._plant.measured.position.tolist()
        return x, y

    @property
    def acting(self) -> tuple[float, float]:
        """Motor force (x, y) [N] at the end of the last tick."""
        x, y = self._drive.acting.tolist()
        return x, y

    def step(self, force_x: float, force_y: float, person_x: float, person_y: float) -> None:
        """Simulate one tick with the commanded force and the person's force person_x, person_y on the handle [N]."""
        self._plant.step((force_x, force_y), (person_x, person_y, 0.0))
        self._show()

    def _show(self) -> None:
        truth = self._plant.truth
        self.x, self.y = truth.position.tolist()
        self.vx, self.vy = truth.velocity.tolist()
        self.measured_x, self.measured_y = self._drive.measured.tolist()
