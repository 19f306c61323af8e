"""Drives that turn commands into joint torques: velocity servo, position servo, hand force, hand force loop."""

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
"""Largest bandwidth [Hz] of a servo."""


class DriveState(NamedTuple):
    """State of the robot as a drive measures it, without delay and noise."""

    position: Array
    velocity: Array
    jacobian: Callable[[], Array]
    """Function that returns the Jacobian (3, n) of the hand's position."""
    acceleration: Array
    """Joint accelerations (n,) [rad/s^2, m/s^2] in the last physics step."""
    touch: Array
    """Contact force (3,) [N] on the hand in the last physics step."""


class Drive(Protocol):
    """A low-level controller of the robot; the plant calls it in each physics step."""

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start with the robot at rest at `position` (n,); return the command that holds the robot there.

        Parameters
        ----------
        inertia : typical inertia (n,) of each joint [kg m^2, kg].
        limit : largest torques (n,) [N m, N]. step : duration of a physics step [s].
        """
        ...

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Joint torques (n,) [N m, N] within the limits; `feedforward` (n,): gravity and Coriolis torques."""
        ...


class VelocityServo:
    """Velocity servo with the torque I (w e + w^2/4 integral of e), where e is the velocity error of a joint.

    I is the joint's typical inertia and w the gain [rad/s]. Both closed-loop poles are at -w/2; the bandwidth (-3 dB)
    is 1.24 w. The torque is limited; while a torque is at its limit, the integral is held.

    Parameters
    ----------
    bandwidth : bandwidth of the joint velocity [Hz].
    """

    def __init__(self, bandwidth: float = 24.0) -> None:
        self._rate = 2 * math.pi * _hertz(bandwidth) / 1.2409

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start at rest; the returned command is zero velocity."""
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
    """Position servo with the torque I (w^2 (q_c - q) - 2 w v), a critically damped spring, within the torque limit.

    I is the joint's typical inertia, w the natural frequency [rad/s], q_c the commanded position, q the position and v
    the velocity. The bandwidth (-3 dB) is 0.64 w. A position that moves at constant speed is tracked with a lag of 2/w.

    Parameters
    ----------
    bandwidth : bandwidth of the joint position [Hz].
    """

    def __init__(self, bandwidth: float = 24.0) -> None:
        self._rate = 2 * math.pi * _hertz(bandwidth) / 0.6436

    @property
    def lag(self) -> float:
        """Lag [s] behind a commanded position that moves at constant speed."""
        return 2 / self._rate

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start at rest; the returned command is the current position."""
        self._inertia, self._limit = inertia, limit
        return position.copy()

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Torque for commanded joint positions (n,) [rad, m]."""
        pull = self._rate * self._rate * (command - state.position) - 2 * self._rate * state.velocity
        given: Array = np.clip(feedforward + self._inertia * pull, -self._limit, self._limit)
        return given


class HandForce:
    """Applies a force F at the hand through the transposed Jacobian.

    F follows the commanded force F_c with the first-order lag T F' = F_c - F, where T is `lag`. The joint
    torques are limited.

    Parameters
    ----------
    lag : time constant [s], 0 for none.
    axes : number of commanded force components: 2 (x and y of the base frame) or 3.
    """

    acting: Array
    """Force (axes,) [N] that acts on the hand if no joint is at its torque limit."""

    def __init__(self, lag: float = 0.0, *, axes: int = 2) -> None:
        if not 0.0 <= lag < math.inf:
            raise ConfigurationError("lag", lag, "seconds, zero or more")
        if axes not in (2, 3):
            raise ConfigurationError("axes", axes, "2 or 3")
        self._lag, self._axes = lag, axes
        self.acting = np.zeros(axes)

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """Start at rest; the returned command is zero force."""
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
    """Force loop of two axes: motor force u = F + gain e + integral * int e dt, with e = F - measured force.

    F is the commanded force. While u is at its limit, the integral is held.

    Parameters
    ----------
    gain, integral : gains of the loop [1], [1/s]. limit : largest motor force [N].
    step : time between two calls for the same axis [s].
    """

    __slots__ = ("_gain", "_integral", "_limit", "_summed")

    def __init__(self, gain: float, integral: float, limit: float, *, step: float) -> None:
        self._gain, self._integral, self._limit = gain, integral * step, limit
        self._summed = [0.0, 0.0]

    def motor(self, axis: int, error: float, force: float) -> float:
        """Motor force [N] of `axis` (0 or 1) for an `error` e [N] and a commanded `force` F [N]."""
        summed = self._summed[axis] + self._integral * error
        motor = force + self._gain * error + summed
        if -self._limit <= motor <= self._limit:
            self._summed[axis] = summed
            return motor
        return min(max(motor, -self._limit), self._limit)


class HandForceLoop:
    """Drive of a planar robot that measures and controls its force on the hand: a `ForceLoop`, then a lag.

    The force sensor between robot and hand measures held_mass * a - touch, with the hand's acceleration a and the
    contact force `touch` on the hand.

    Parameters
    ----------
    gain, integral : gains of the loop [1], [1/s]. limit : largest motor force per axis [N].
    held_mass : mass of the hand [kg]. lag : time constant of the motor force [s], 0 for none.
    noise : standard deviation of the force sensor per axis [N]. rng : random generator of the noise.
    """

    acting: Array
    """Current motor force (2,) [N]."""
    measured: Array
    """Measured force (2,) [N] on the hand."""

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
        """Start at rest; the returned command is zero force."""
        self._loop = ForceLoop(*self._gains, step=step)
        still = self._force.start(position, inertia, limit, step)
        self.acting, self.measured = self._force.acting, np.zeros(2)
        return still

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """Motor force (2,) [N] for a commanded force (2,) [N] on the hand."""
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
