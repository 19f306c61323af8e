"""Velocity interval of each joint in this tick, and braking of the whole robot together.

Velocity limits take precedence over position limits, these over accelerations, and these over the task. With this order
the QP's box is never empty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import clipped

__all__ = [
    "BrakingTogether",
    "VelocityBounds",
    "max_change",
    "slowed_together",
    "stopping_speed",
    "ticks_to_rest",
    "velocity_bounds",
]

OUTSIDE = 1e-9
"""[rad or m] A joint less than this beyond its limit counts as at the limit."""

ROUNDED = 1e-11
"""[rad or m] A stop ends this much before a limit, to cover the rounding of thousands of ticks."""

FAR = 1e9
"""Value that replaces an infinite limit."""

GENTLE, APPROACH = 0.7, 30.0
"""Fraction of the acceleration limit that braking before a position limit uses; final rate [1/s] of the approach to the
position limit. After a harder deceleration, a servo overshoots.
"""


class VelocityBounds(NamedTuple):
    """Nested intervals of joint velocity, as (n,) expressions; never empty."""

    lower: ca.SX
    upper: ca.SX
    brake_lower: ca.SX
    """Bounds that do not require a joint to stop before its limit or to return; a braking command must satisfy them."""
    brake_upper: ca.SX
    stop_lower: ca.SX
    """Bounds by the position limits alone."""
    stop_upper: ca.SX
    outside: ca.SX
    """1 if any joint is beyond its limit."""
    hard_lower: ca.SX
    """Bounds without accelerations: the speed limit, and no motion beyond (or further beyond) a position limit."""
    hard_upper: ca.SX

    @property
    def hard(self) -> tuple[ca.SX, ca.SX]:
        """`hard_lower` and `hard_upper`."""
        return self.hard_lower, self.hard_upper


def velocity_bounds(
    chain: SerialChain,
    q: ca.SX,
    last: ca.SX,
    *,
    dt: float,
    recovery_speed: float,
    approach: float = APPROACH,
) -> VelocityBounds:
    """Intervals of the joint velocities that are held until the next tick.

    From every state in which the joints can still stop, all bounds can be satisfied together, and the joints can stop
    in the next state, too, at any dt.

    Parameters
    ----------
    q, last : (n,) current joint positions, and velocities commanded in the last tick. dt : tick [s].
    recovery_speed : return speed of a joint outside its limits, as a fraction of its velocity limit.
    approach : [1/s] see `gentle_speed`; infinite for joints that move as commanded.
    """
    speed = ca.DM(chain.velocity)
    change = max_change(chain, dt)
    # Infinite limits become finite ones that never matter.
    room_up = ca.DM(np.clip(chain.upper, -FAR, FAR)) - q
    room_down = q - ca.DM(np.clip(chain.lower, -FAR, FAR))
    above, below = room_up < -OUTSIDE, room_down < -OUTSIDE
    back, rate = recovery_speed * speed, min(1 / dt, approach)

    # Hard: the speed limit, and no motion beyond a position limit. From outside, a joint returns at most at `back`.
    hard_upper = clipped(room_up * (1 / dt), 0, ca.if_else(below, back, speed))
    hard_lower = -clipped(room_down * (1 / dt), 0, ca.if_else(above, back, speed))
    # Then acceleration, as far as the hard interval allows it.
    brake_lower = clipped(last - change, hard_lower, hard_upper)
    brake_upper = clipped(last + change, hard_lower, hard_upper)
    # Then the speed from which the joint can still stop at its limit, plus the return speed, at whose end the joint can
    # stop, too. One of these two is zero.
    can_stop_up, can_stop_down = (
        ca.fmin(stopping_speed(room, change, dt), gentle_speed(room, change / dt, approach))
        for room in (room_up, room_down)
    )
    stop_upper = can_stop_up + ca.fmax(ca.fmax(ca.fmin(room_up * rate, 0), -back), -can_stop_down)
    stop_lower = -can_stop_down - ca.fmax(ca.fmax(ca.fmin(room_down * rate, 0), -back), -can_stop_up)
    return VelocityBounds(
        lower=clipped(stop_lower, brake_lower, brake_upper),
        upper=clipped(stop_upper, brake_lower, brake_upper),
        brake_lower=brake_lower,
        brake_upper=brake_upper,
        stop_lower=stop_lower,
        stop_upper=stop_upper,
        outside=ca.sum1(ca.logic_or(above, below)) > 0,
        hard_lower=hard_lower,
        hard_upper=hard_upper,
    )


def max_change(chain: SerialChain, dt: float) -> ca.DM:
    """(n,) largest change of each joint's velocity in a tick of dt [s] by its acceleration limit, at most 2 v_max."""
    return ca.DM(np.minimum(chain.acceleration * dt, 2 * chain.velocity))


def stopping_speed(room: ca.SX, change: ca.DM, dt: float) -> ca.SX:
    """Largest speed for one tick after which the joint, slowing by `change` a tick, stops within the distance `room`.

    A speed v is held for dt, then v - change and so on, for k = floor(v/change) further ticks. The stopping distance is
    dt ((k + 1) v - change k (k + 1)/2); this function inverts the relation.
    """
    room = ca.fmax(room - ROUNDED, 0)
    ticks = ca.floor(0.5 * ca.sqrt(1 + room * (8 / (change * dt))) - 0.5)
    return room * (1 / dt) / (ticks + 1) + (0.5 * change) * ticks


def gentle_speed(room: ca.SX, acceleration: ca.DM, approach: float) -> ca.SX:
    """Largest speed towards a limit at which a delayed servo does not overshoot the limit.

    Near the limit the speed is `approach` times the distance `room`. Further away it follows the braking parabola for
    `GENTLE` times the acceleration.
    """
    if approach == math.inf:
        return ca.SX.inf(room.shape)
    room, gentle = ca.fmax(room, 0), GENTLE * acceleration
    near = gentle / approach**2
    return ca.if_else(room <= near, approach * room, ca.sqrt(2 * gentle * ca.fmax(room - near / 2, 0)))


SLACK = 1.1
"""Ratio of T to the stopping time; the excess reserves acceleration for changes of the task and limits."""
FARTHEST = 0.2
"""[rad, m] Largest motion of the stop posture in a tick, since limits are tangents there."""
LATER = 0.3
"""[s] A velocity off the command's direction decays to zero within this time plus T / 1.1."""


class BrakingTogether:
    """Braking of all joints together: every velocity shrinks by the same fraction per tick.

    T is the time in which every joint can stop from its largest speed, and u are the velocities of all joints. Braking,
    u <- (1 - dt/T) u, ends at the stop posture

        z = q + T u.

    Braking does not move z: after a tick q + dt u + T (1 - dt/T) u = z. A controller that satisfies its limits at z and
    on the way from q to z can therefore always brake without violating them, within every joint's acceleration.

    moving : indices of the joints that can move; others do not affect T.
    """

    def __init__(self, chain: SerialChain, dt: float, *, moving: Sequence[int]) -> None:
        self.time = SLACK * max(dt, float(np.max((chain.velocity / chain.acceleration)[moving])))
        """T [s]."""
        farthest = np.maximum(FARTHEST, SLACK * chain.velocity * dt) / self.time
        self.change = ca.fmin(max_change(chain, dt), ca.DM(farthest))
        """(n,) largest change of velocity in a tick, by the acceleration limit and `FARTHEST`."""
        self._left = 1 - dt / self.time
        stopping = self.time / SLACK
        self._part = stopping / (stopping + LATER)

    def slower(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after a tick of braking with an unchanged stop posture."""
        return self._left * velocity

    def slowest(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after a tick of the hardest braking of all joints together."""
        return slowed_together(velocity, self.change)

    def leaves(self, velocity: ca.SX) -> ca.SX:
        """Largest fraction of a velocity off the command's direction that may remain after a tick; see `LATER`."""
        return ca.fmin(self._left, 1 - self._part * _taken_away(velocity, self.change))


def ticks_to_rest(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """Number of ticks in which velocities (n,) come to rest, with changes of at most `change` (n,)."""
    return ca.mmax(ca.fabs(velocity) / change)


def slowed_together(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """(n,) velocities after a tick in which all shrink by the largest common fraction."""
    return velocity * (1 - _taken_away(velocity, change))


def _taken_away(velocity: ca.SX, change: ca.DM) -> ca.SX:
    return 1 / ca.fmax(ticks_to_rest(velocity, change), 1)
