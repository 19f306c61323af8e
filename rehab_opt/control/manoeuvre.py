"""The braking manoeuvre, and the joint velocities from which it ends within the joint limits.

All joints slow down by the same fraction per tick, as fast as the slowest joint allows. From joint positions q and
velocities v, braking leads along a straight line in joint space to the stop posture

    stop(q, v) = q + dt F v,    N = max_i |v_i| / (a_i dt),    F = n - n (n + 1) / (2 N),    n = floor(N),

with the accelerations a_i. A joint that would pass its limit brakes harder and stops at the limit.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.control.stopping import (
    APPROACH,
    gentle_speed,
    max_change,
    slowed_together,
    stopping_speed,
    ticks_to_rest,
)
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import clipped

__all__ = ["ROUNDED", "Intervals", "Manoeuvre", "further"]

FAR = 1e9
"""[rad or m] Value that replaces an infinite limit."""
ROUNDED = 1e-10
"""Tolerance of the braking duration for rounding, in ticks."""
OUTSIDE = 1e-9
"""[rad or m] A joint less than this beyond its limit counts as at the limit."""


class Intervals(NamedTuple):
    """Lower and upper ends, (n,) each, of three velocity intervals per joint; no interval is empty."""

    least: ca.SX
    most: ca.SX
    """Allowed commands: each joint can still stop at its limit within its acceleration."""
    gentle_least: ca.SX
    gentle_most: ca.SX
    """Allowed commands that approach the limit at the rate `APPROACH`."""
    low: ca.SX
    high: ca.SX
    """Interval of target velocities, whatever the last command was: a joint stays within its limit even if it brakes
    for as long as the slowest joint.
    """


def further(ticks: ca.SX) -> ca.SX:
    """Braking distance F over `ticks` ticks, in units of the distance that one tick at full velocity covers."""
    n = ca.floor(ticks)
    return n - n * (n + 1) / (2 * ca.fmax(ticks, 1e-12))


class Manoeuvre:
    """Braking of a chain within its limits of position, velocity and acceleration, at ticks of dt [s].

    `recovery_speed` : return speed of a joint outside its limits, as a fraction of its velocity limit.
    """

    def __init__(self, chain: SerialChain, dt: float, *, recovery_speed: float) -> None:
        self.dt, self.speed, self.change = dt, ca.DM(chain.velocity), max_change(chain, dt)
        self._low, self._high = ca.DM(np.maximum(chain.lower, -FAR)), ca.DM(np.minimum(chain.upper, FAR))
        self.back = recovery_speed * self.speed

    def ticks(self, velocity: ca.SX) -> ca.SX:
        """N: ticks of braking from velocities (n,)."""
        return ticks_to_rest(velocity, self.change)

    def braked(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after one tick of braking."""
        last_one = self.ticks(velocity) <= 1 + ROUNDED
        return ca.if_else(last_one, 0, slowed_together(velocity, self.change))

    def place(self, q: ca.SX, velocity: ca.SX, ticks: ca.SX | float) -> ca.SX:
        """Joint positions (n,) after 1 + `ticks` ticks at `velocity` (n,), clipped to the limits."""
        ahead = q + self.dt * velocity * (1 + ticks)
        return clipped(ahead, ca.fmin(self._low, q), ca.fmax(self._high, q))

    def intervals(self, q: ca.SX, last: ca.SX) -> Intervals:
        """Velocity intervals of joints at q (n,) after the command `last` (n,).

        Velocity limits take precedence over position limits, and these over accelerations.
        """
        dt, speed, change = self.dt, self.speed, self.change
        seconds = dt * (1 + further(self.ticks(last) + 1))
        rooms = q - self._low, self._high - q
        fast = [ca.if_else(other < -OUTSIDE, self.back, speed) for other in reversed(rooms)]
        hard = [clipped(room / dt, 0, most) for room, most in zip(rooms, fast, strict=True)]
        least, most = (clipped(last + sign * change, -hard[0], hard[1]) for sign in (-1, 1))
        hardest = [stopping_speed(room, change, dt) for room in rooms]
        gentle = [ca.fmin(v, gentle_speed(room, change / dt, APPROACH)) for v, room in zip(hardest, rooms, strict=True)]
        sides = []
        for i, (sign, room) in enumerate(zip((-1, 1), rooms, strict=True)):
            # The return from beyond a limit ends gently, too; a joint may have no range at all.
            back = ca.fmax(clipped((room + OUTSIDE) / dt, -self.back, 0), -gentle[1 - i])
            stops, gently = hardest[i] + back, gentle[i] + back
            aimed = ca.fmin(ca.fmin(gently, ca.fmax(room, 0) / seconds), speed)
            sides.append((clipped(sign * stops, least, most), clipped(sign * gently, least, most), sign * aimed))
        return Intervals(*(end for both in zip(*sides, strict=True) for end in both))

    def outside(self, q: ca.SX) -> ca.SX:
        """Whether a joint is beyond its limit."""
        return ca.sum1(ca.logic_or(q > self._high + OUTSIDE, q < self._low - OUTSIDE)) > 0
