"""Drives, from commands to torques: velocity servo, position servo, hand force with or without a sensor."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["Drive", "DriveState", "ForceLoop", "HandForce", "HandForceLoop", "PositionServo", "VelocityServo"]

Array = NDArray[np.float64]

FASTEST = 1000.0
"""[Hz] Largest bandwidth of a servo."""


class DriveState(NamedTuple):
    """State of its own joints that a drive measures, without delay and noise."""

    position: Array
    velocity: Array
    jacobian: Callable[[], Array]
    """(3, n) Jacobian of the hand's position."""
    acceleration: Array
    """(n,) [rad/s^2, m/s^2] in the last physics step."""
    touch: Array
    """(3,) [N] contact force on the hand in the last physics step."""


class Drive(Protocol):
    """A low-level controller of the robot, in physics steps."""

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start at rest at `position` (n,); returns the command that holds it there.

        Parameters
        ----------
        inertia : (n,) [kg m^2, kg] typical inertia of each joint.
        limit : (n,) [N m, N] largest torque. step : [s] physics step.
        """
        ...

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """(n,) [N m, N] within the limits; `feedforward` (n,) contains gravity and velocity torques."""
        ...


class VelocityServo:
    """Proportional-integral loop of the joint's speed: I (w (v_c - v) + w^2/4 integral of v_c - v), torque-limited.

    With the joint's own inertia I both poles are at w/2, and the speed follows up to `bandwidth` (-3 dB at 1.24 w). The
    integral is held while the torque is at its limit.

    Parameters
    ----------
    bandwidth : [Hz]
    """

    def __init__(self, bandwidth: float = 24.0) -> None:
        self._rate = 2 * math.pi * _hertz(bandwidth) / 1.2409

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start at rest; the command is zero velocity."""
        self._inertia, self._limit, self._step = inertia, limit, step
        self._summed = np.zeros(len(position))
        return np.zeros(len(position))

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Torque for commanded joint velocities (n,) [rad/s, m/s]."""
        error = command - state.velocity
        summed = self._summed + (self._rate**2 / 4 * self._step) * error
        unsaturated = feedforward + self._inertia * (self._rate * error + summed)
        given: Array = np.clip(unsaturated, -self._limit, self._limit)
        self._summed = np.where(given == unsaturated, summed, self._summed)
        return given


class PositionServo:
    """Critically damped spring to the commanded position: I (w^2 (q_c - q) - 2 w v), torque-limited.

    Its position follows up to `bandwidth` (-3 dB at 0.64 w) with a lag of 2/w, without velocity feedforward.

    Parameters
    ----------
    bandwidth : [Hz]
    """

    def __init__(self, bandwidth: float = 24.0) -> None:
        self._rate = 2 * math.pi * _hertz(bandwidth) / 0.6436

    @property
    def lag(self) -> float:
        """[s] lag behind a position that moves at constant speed."""
        return 2 / self._rate

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start at rest; the command is the position."""
        self._inertia, self._limit = inertia, limit
        return position.copy()

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Torque for commanded joint positions (n,) [rad, m]."""
        pull = self._rate * self._rate * (command - state.position) - 2 * self._rate * state.velocity
        given: Array = np.clip(feedforward + self._inertia * pull, -self._limit, self._limit)
        return given


class HandForce:
    """A force at the hand through the transposed Jacobian, with first-order lag: lag F' = F_c - F; torque-limited.

    Parameters
    ----------
    lag : [s] time constant, 0 for none.
    axes : number of commanded force components: 2 in the plane x, y of the base frame, or 3.
    """

    acting: Array
    """(axes,) [N] acting force, if no joint is at its torque limit."""

    def __init__(self, lag: float = 0.0, *, axes: int = 2) -> None:
        if not 0.0 <= lag < math.inf:
            raise ConfigurationError("lag", lag, "seconds, zero or more")
        if axes not in (2, 3):
            raise ConfigurationError("axes", axes, "2 or 3")
        self._lag, self._axes = lag, axes
        self.acting = np.zeros(axes)

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """No force."""
        self._limit = limit
        self._keep = math.exp(-step / self._lag) if self._lag else 0.0
        self.acting = np.zeros(self._axes)
        return np.zeros(self._axes)

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Torque for a commanded force (axes,) [N] in the base frame."""
        self.acting = command + self._keep * (self.acting - command)
        given: Array = np.clip(feedforward + state.jacobian()[: self._axes].T @ self.acting, -self._limit, self._limit)
        return given


class ForceLoop:
    """u = F + gain e + integral * int e, with e = F - measured force; the integral is held while u is at its limit.

    Parameters
    ----------
    gain, integral : [1], [1/s]. limit : [N] of the motors. step : [s] between two calls for an axis.
    """

    __slots__ = ("_gain", "_integral", "_limit", "_summed")

    def __init__(self, gain: float, integral: float, limit: float, *, step: float) -> None:
        self._gain, self._integral, self._limit = gain, integral * step, limit
        self._summed = [0.0, 0.0]

    def motor(self, axis: int, error: float, force: float) -> float:
        """[N] motor force of `axis`, 0 or 1."""
        summed = self._summed[axis] + self._integral * error
        motor = force + self._gain * error + summed
        if -self._limit <= motor <= self._limit:
            self._summed[axis] = summed
            return motor
        return min(max(motor, -self._limit), self._limit)


class HandForceLoop:
    """A point mass on two axes with measured and controlled force on the hand: `ForceLoop`, then a lag.

    The sensor is between robot and hand and measures held_mass * a - touch.

    Parameters
    ----------
    gain, integral : [1], [1/s] of the loop. limit : [N] of the motors, per axis. held_mass : [kg] of the hand.
    lag : [s] time constant of the motors' force, 0 for none. noise : [N] of the sensor, per axis.
    rng : random generator of the noise.
    """

    acting: Array
    """(2,) [N] current motor force."""
    measured: Array
    """(2,) [N] measured force on the hand."""

    def __init__(
        self,
        gain: float,
        integral: float,
        limit: float,
        *,
        held_mass: float,
        lag: float = 0.0,
        noise: float = 0.0,
        rng: np.random.Generator,
    ) -> None:
        self._gains, self._held, self._noise, self._rng = (gain, integral, limit), held_mass, noise, rng
        self._force = HandForce(lag)

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """No force."""
        self._loop = ForceLoop(*self._gains, step=step)
        still = self._force.start(position, inertia, limit, step)
        self.acting, self.measured = self._force.acting, np.zeros(2)
        return still

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Motor force (2,) [N] for a commanded force on the hand (2,) [N]."""
        self.measured = self._held * state.acceleration - state.touch[:2]
        if self._noise:
            self.measured = self.measured + self._noise * self._rng.standard_normal(2)
        error = command - self.measured
        motor = [self._loop.motor(axis, float(error[axis]), float(command[axis])) for axis in (0, 1)]
        given = self._force.torque(np.array(motor), state, feedforward)
        self.acting = self._force.acting
        return given


def _hertz(bandwidth: float) -> float:
    if not 0.0 < bandwidth <= FASTEST:
        raise ConfigurationError("bandwidth", bandwidth, f"hertz above 0, at most {FASTEST:g}")
    return bandwidth
