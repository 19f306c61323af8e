"""How fast each joint may move in this tick, as one interval a joint, and how the whole robot brakes together.

The order in which bounds yield is decided here, joint by joint, in closed form, so that the QP's box is never empty:
velocity never; then never further outside a joint limit; then acceleration; then the task.
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
    "nearest_to_rest",
    "slowed_together",
    "stopping_speed",
    "ticks_to_rest",
    "velocity_bounds",
]

OUTSIDE = 1e-9
"""[rad or m] A joint less than this beyond its limit stands at it: rounding is no excursion."""

ROUNDED = 1e-11
"""[rad or m] A stop ends this much before a limit: what thousands of rounded ticks take of its way at most, where the
last would have to brake harder for it."""

FAR = 1e9
"""A limit that is never felt."""

GENTLE, APPROACH = 0.7, 30.0
"""Fraction of the acceleration limit that braking before a limit takes, and rate [1/s] at which a joint comes to it at
last: a servo runs past the end of a hard deceleration."""


class VelocityBounds(NamedTuple):
    """Intervals of joint velocity, each inside the one before it; (n,) expressions, never empty."""

    lower: ca.SX
    upper: ca.SX
    brake_lower: ca.SX
    """Bounds without the need to be able to stop or to come back: what a braking command has to keep."""
    brake_upper: ca.SX
    stop_lower: ca.SX
    """Bounds by the position limits alone."""
    stop_upper: ca.SX
    outside: ca.SX
    """1 where any joint is beyond its limit."""
    hard_lower: ca.SX
    """Bounds without acceleration: speed, and in this tick not beyond, or not further beyond, a position limit."""
    hard_upper: ca.SX

    @property
    def hard(self) -> tuple[ca.SX, ca.SX]:
        """Both ends of the last."""
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
    """Interval of the joint velocity that is held from now until the next tick.

    Parameters
    ----------
    chain : its position, velocity and acceleration limits.
    q : (n,) joint positions now.
    last : (n,) joint velocity commanded in the last tick.
    dt : tick [s].
    recovery_speed : fraction of the velocity limit at which a joint outside its limits comes back.
    approach : [1/s] see `gentle_speed`; infinite for joints that move as commanded.

    From every state that can still stop, all bounds hold together and the next state can stop again, exactly, at any
    dt (the recursion is over ticks, not over continuous time). Other states brake at the largest deceleration.
    """
    speed = ca.DM(chain.velocity)
    change = max_change(chain, dt)
    # Infinite limits become ones that are never felt.
    room_up = ca.DM(np.clip(chain.upper, -FAR, FAR)) - q
    room_down = q - ca.DM(np.clip(chain.lower, -FAR, FAR))
    above, below = room_up < -OUTSIDE, room_down < -OUTSIDE
    back, rate = recovery_speed * speed, min(1 / dt, approach)

    # Hard: speed, and in this tick not beyond the limit, or when beyond it not further and not faster back than `back`.
    hard_upper = clipped(room_up * (1 / dt), 0, ca.if_else(below, back, speed))
    hard_lower = -clipped(room_down * (1 / dt), 0, ca.if_else(above, back, speed))
    # Then acceleration, as far as the hard interval leaves it.
    brake_lower = clipped(last - change, hard_lower, hard_upper)
    brake_upper = clipped(last + change, hard_lower, hard_upper)
    # Then a speed from which the joint still stops at its limit, or the way back, at the end of which it can stop too:
    # of a joint's two speeds one is zero.
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
    """(n,) largest change of each joint's velocity in a tick of dt [s]: what its acceleration limit allows.

    One beyond 2 v_max no bound could forbid; so infinite accelerations become finite.
    """
    return ca.DM(np.minimum(chain.acceleration * dt, 2 * chain.velocity))


def stopping_speed(room: ca.SX, change: ca.DM, dt: float) -> ca.SX:
    """Largest speed for one tick after which the joint, slowing by `change` a tick, stops within `room`.

    A speed v is held for dt, then v - change, v - 2 change and so on: k = floor(v/change) further ticks, in all
    dt ((k + 1) v - change k (k + 1)/2). That is piecewise linear in v; this is its inverse. Zero without room.
    """
    room = ca.fmax(room - ROUNDED, 0)
    ticks = ca.floor(0.5 * ca.sqrt(1 + room * (8 / (change * dt))) - 0.5)
    return room * (1 / dt) / (ticks + 1) + (0.5 * change) * ticks


def gentle_speed(room: ca.SX, acceleration: ca.DM, approach: float) -> ca.SX:
    """Largest speed towards a limit from which a late servo, which overshoots while it brakes, does not pass it.

    In the vicinity `approach` times the room, so that braking fades out; from where that would take more than
    `GENTLE` of the acceleration on, the parabola of that deceleration, which goes over into the line without a kink.
    """
    if approach == math.inf:
        return ca.SX.inf(room.shape)
    room, gentle = ca.fmax(room, 0), GENTLE * acceleration
    near = gentle / approach**2
    return ca.if_else(room <= near, approach * room, ca.sqrt(2 * gentle * ca.fmax(room - near / 2, 0)))


def nearest_to_rest(bounds: VelocityBounds) -> ca.SX:
    """(n,) the velocity nearest to rest that the bounds allow: the safe command.

    A joint outside its limits is not led back by it: who let go of the enable switch wants no motion.
    """
    return clipped(ca.SX.zeros(bounds.lower.shape), bounds.brake_lower, bounds.brake_upper)


SLACK = 1.1
"""T is longer by this than stopping takes: a task and a limit that turn on the way need acceleration, too."""
FARTHEST = 0.2
"""[rad, m] Way of the stop posture in a tick, at most: limits are tangents there."""
LATER = 0.3
"""[s] after T / 1.1 a velocity that must go is gone. Of 1 s, which the promise has, the bend of the way takes the
rest."""


class BrakingTogether:
    """Braking of one robot together: every velocity shrinks by the same fraction a tick, and no position drifts on.

    With T the time in which every joint can stop from its largest speed, and u the velocities of all joints, braking is
    u <- (1 - dt/T) u. The posture where that ends is the stop posture

        z = q + T u.

    Braking does not move it: after a tick q + dt u + T (1 - dt/T) u = z. A controller that keeps its limits at z and on
    the way from q to z can therefore always brake without breaking any of them, within every joint's acceleration,
    since |u| dt/T <= v dt/T <= a dt. What a tick adds to u moves z by T times as much; that is all a limit must ask
    about.

    Parameters
    ----------
    chain : its velocity and acceleration limits.
    dt : tick [s].
    moving : joints that move at all, by number from 0; one that stands does not make T longer.
    """

    def __init__(self, chain: SerialChain, dt: float, *, moving: Sequence[int]) -> None:
        self.time = SLACK * max(dt, float(np.max((chain.velocity / chain.acceleration)[moving])))
        """T [s]."""
        farthest = np.maximum(FARTHEST, SLACK * chain.velocity * dt) / self.time
        self.change = ca.fmin(max_change(chain, dt), ca.DM(farthest))
        """(n,) largest change of a velocity in a tick: the acceleration's, and z moves by `FARTHEST` at most."""
        self._left = 1 - dt / self.time
        stopping = self.time / SLACK
        self._part = stopping / (stopping + LATER)

    def slower(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after a tick of braking that leaves the stop posture where it is."""
        return self._left * velocity

    def slowest(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after a tick of the hardest braking; it ends at rest, on the way to the stop posture."""
        return slowed_together(velocity, self.change)

    def leaves(self, velocity: ca.SX) -> ca.SX:
        """Fraction that is left of a velocity that must go, at most, so that it is gone `LATER` than T / 1.1.

        `slower` alone never ends.
        """
        return ca.fmin(self._left, 1 - self._part * _taken_away(velocity, self.change))


def ticks_to_rest(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """Ticks in which velocities (n,) come to rest that change by `change` (n,) a tick at most: the slowest one's."""
    return ca.mmax(ca.fabs(velocity) / change)


def slowed_together(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """(n,) velocities after a tick in which all shrink by the same fraction, as large as `change` (n,) allows."""
    return velocity * (1 - _taken_away(velocity, change))


def _taken_away(velocity: ca.SX, change: ca.DM) -> ca.SX:
    """Fraction that such a tick takes away."""
    return 1 / ca.fmax(ticks_to_rest(velocity, change), 1)
