"""A simulated planar robot with a proportional-integral loop of its force on the hand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.plants.drives import ForceLoop

__all__ = ["ForceRobot", "RobotModel"]

SMOOTH = 2e-3
"""[m/s] Speed below which dry friction is smoothed to zero."""


@dataclass(frozen=True)
class RobotModel:
    """Parameters of a planar robot, its force loop and its stops.

    The motors give u = F + gain e + integral * int e, with e = F - measured force on the hand; robot and hand move
    together, (m_robot + m_hand) a = u - friction + force of the person. All numbers are assumptions, because the paper
    publishes none.

    Parameters
    ----------
    mass : [kg] effective mass at the handle. viscous : [N s/m]. coulomb : [N] dry friction.
    gain, integral : [1], [1/s] of the force loop; gain + integral dt / 2 must be below (m_robot + m_hand) / m_hand,
        because the measured force is one tick old.
    noise : [N] standard deviation of the force sensor, per axis.
    motor_limit : [N] per axis.
    lower, upper : (2,) [m] mechanical stops in the robot's frame.
    """

    mass: float = 1.5
    viscous: float = 3.0
    coulomb: float = 1.5
    gain: float = 0.8
    integral: float = 60.0
    noise: float = 0.05
    motor_limit: float = 80.0
    lower: tuple[float, float] = (-math.inf, -math.inf)
    upper: tuple[float, float] = (math.inf, math.inf)

    def check(self, hand_mass: float, *, dt: float) -> None:
        """Raise an error for a loop that is unstable with this hand in ticks of `dt` [s].

        Raises
        ------
        ConfigurationError : the gains are too large.
        """
        most = (self.mass + hand_mass) / hand_mass
        added = 0.5 * self.integral * dt
        if not self.gain + added < most:
            expected = f"less than {most - added:.3g}: {most:.3g} for a hand of {hand_mass:g} kg, less integral dt / 2"
            raise ConfigurationError("gain", self.gain, expected)

    def growth(self, hand_mass: float, *, stiffness: float, damping: float, dt: float) -> float:
        """Growth factor per tick of the fastest growing mode, with the hand on a spring and a damper; 1 for none.

        It is for one axis without command, within the motors' limit and without dry friction.
        """
        whole = self.mass + hand_mass
        # Rows of place, speed, measured force, integral: first the acceleration, from which they follow.
        summed = np.array([0.0, 0.0, -self.integral * dt, 1.0])
        push = np.array([-stiffness, -damping, 0.0, 0.0])
        motor = summed - self.gain * np.array([0.0, 0.0, 1.0, 0.0])
        acceleration = (motor + push - np.array([0.0, self.viscous, 0.0, 0.0])) / whole
        speed = np.array([0.0, 1.0, 0.0, 0.0]) + dt * acceleration
        place = np.array([1.0, 0.0, 0.0, 0.0]) + dt * speed
        steps = np.stack((place, speed, hand_mass * acceleration - push, summed))
        return float(np.abs(np.linalg.eigvals(steps)).max())


class ForceRobot:
    """The robot with a hand on its handle, simulated tick by tick.

    Parameters
    ----------
    model : the robot. hand_mass : [kg] of the hand and arm.
    start : (2,) [m] at rest. dt : [s] of a tick. rng : random generator of the noise. ticks : largest number.

    Raises
    ------
    ConfigurationError : see `RobotModel.check`.
    """

    __slots__ = (
        "_dt", "_hand_mass", "_loop", "_model", "_noise", "_tick", "acting", "measured_x", "measured_y", "vx", "vy",
        "x", "y",
    )  # fmt: skip

    def __init__(
        self,
        model: RobotModel,
        *,
        hand_mass: float,
        start: tuple[float, float],
        dt: float,
        rng: np.random.Generator,
        ticks: int,
    ) -> None:
        model.check(hand_mass, dt=dt)
        self._model, self._hand_mass, self._dt = model, hand_mass, dt
        self.x, self.y = map(float, start)
        self.vx = self.vy = self.measured_x = self.measured_y = 0.0
        self.acting = (0.0, 0.0)
        self._loop = ForceLoop(model.gain, model.integral, model.motor_limit, step=dt)
        self._noise: list[list[float]] = (model.noise * rng.standard_normal((ticks, 2))).tolist()
        self._tick = 0

    @property
    def seen(self) -> tuple[float, float]:
        """[m] measured position of the hand, here the true one."""
        return self.x, self.y

    def step(self, force_x: float, force_y: float, person_x: float, person_y: float) -> None:
        """One tick with the commanded force [N] and the person's force person_x, person_y [N] on the handle.

        Afterwards x, y, vx, vy are the new state, measured_x, measured_y the force on the hand in this tick, and
        `acting` the motor force.
        """
        model, dt = self._model, self._dt
        noise_x, noise_y = self._noise[self._tick]
        self._tick += 1
        whole = model.mass + self._hand_mass
        dry = model.coulomb / math.sqrt(self.vx * self.vx + self.vy * self.vy + SMOOTH * SMOOTH)
        # Friction stops within a tick what it can stop; more would turn the hand round, for ever.
        slip = model.viscous + max(0.0, min(dry, whole / dt - model.viscous))

        motor_x = self._loop.motor(0, force_x - self.measured_x, force_x)
        acceleration = (motor_x - slip * self.vx + person_x) / whole
        self.measured_x = self._hand_mass * acceleration - person_x + noise_x
        self.vx += acceleration * dt
        self.x += self.vx * dt

        motor_y = self._loop.motor(1, force_y - self.measured_y, force_y)
        acceleration = (motor_y - slip * self.vy + person_y) / whole
        self.measured_y = self._hand_mass * acceleration - person_y + noise_y
        self.vy += acceleration * dt
        self.y += self.vy * dt

        self.acting = (motor_x, motor_y)
        if not (model.lower[0] <= self.x <= model.upper[0]):
            self.x, self.vx = min(max(self.x, model.lower[0]), model.upper[0]), 0.0
        if not (model.lower[1] <= self.y <= model.upper[1]):
            self.y, self.vy = min(max(self.y, model.lower[1]), model.upper[1]), 0.0
