"""A simulated planar robot with proportional-integral control of the force on the hand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.plants.drives import ForceLoop

__all__ = ["ForceRobot", "RobotModel"]

SMOOTH = 2e-3
"""Speed [m/s] below which dry friction falls smoothly to zero."""


@dataclass(frozen=True)
class RobotModel:
    """Parameters of a planar robot, its force loop and its mechanical stops.

    For a commanded force F, the motor force is u = F + gain e + integral * int e dt, with e = F - measured force on the
    hand. Robot and hand move together: (m_robot + m_hand) a = u - friction + force of the person. The default numbers
    are assumptions, because the paper does not publish them.

    Parameters
    ----------
    mass : effective mass m_robot at the handle [kg]. viscous : viscous friction [N s/m]. coulomb : dry friction [N].
    gain, integral : gains of the force loop [1], [1/s]. Since the measured force is one tick (dt) old, the loop is
        stable only if gain + integral dt / 2 < (m_robot + m_hand) / m_hand.
    noise : standard deviation of the force sensor per axis [N].
    motor_limit : largest motor force per axis [N].
    lower, upper : mechanical stops (2,) [m] in the robot's frame.
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
        """Check that the force loop is stable with a hand of `hand_mass` [kg] and ticks of `dt` [s].

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
        """Spectral radius of an axis's force loop over one tick, without motor limit and dry friction.

        The hand of `hand_mass` [kg] is on a spring of `stiffness` [N/m] and a damper of `damping` [N s/m].
        """
        whole = self.mass + hand_mass
        # The state is position, speed, measured force, integral; each row below maps the state to one quantity.
        summed = np.array([0.0, 0.0, -self.integral * dt, 1.0])
        push = np.array([-stiffness, -damping, 0.0, 0.0])
        motor = summed - self.gain * np.array([0.0, 0.0, 1.0, 0.0])
        acceleration = (motor + push - np.array([0.0, self.viscous, 0.0, 0.0])) / whole
        speed = np.array([0.0, 1.0, 0.0, 0.0]) + dt * acceleration
        place = np.array([1.0, 0.0, 0.0, 0.0]) + dt * speed
        steps = np.stack((place, speed, hand_mass * acceleration - push, summed))
        return float(np.abs(np.linalg.eigvals(steps)).max())


class ForceRobot:
    """The robot of a `RobotModel` with a hand on its handle, simulated tick by tick.

    Parameters
    ----------
    model : parameters of the robot. hand_mass : effective mass of hand and arm [kg].
    start : position (2,) [m] at the start, at rest. dt : duration of a tick [s].
    rng : random generator of the noise. ticks : largest number of ticks.

    Raises
    ------
    ConfigurationError : the force loop is unstable, as checked by `RobotModel.check`.
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
        """Measured position (x, y) [m] of the hand, here the true position."""
        return self.x, self.y

    def step(self, force_x: float, force_y: float, person_x: float, person_y: float) -> None:
        """Simulate one tick with the commanded force [N] and the person's force person_x, person_y [N] on the handle.

        Then x, y, vx, vy are the new state; measured_x, measured_y are the measured force on the hand; `acting` is the
        motor force.
        """
        model, dt = self._model, self._dt
        noise_x, noise_y = self._noise[self._tick]
        self._tick += 1
        whole = model.mass + self._hand_mass
        dry = model.coulomb / math.sqrt(self.vx * self.vx + self.vy * self.vy + SMOOTH * SMOOTH)
        # Dry friction may stop the hand within a tick, but not reverse its velocity.
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
