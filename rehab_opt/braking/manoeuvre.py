"""The braking manoeuvre: all joints slow down by the same fraction a tick, as fast as the slowest one can.

It leads from (q, v) along a straight line of joint space to the stop posture

    stop(q, v) = q + dt F(N) v,    N = max_i |v_i| / (a_i dt),    F = n - n (n + 1) / (2 N),    n = floor(N).

A joint for which this line ends beyond its limit brakes harder, and stops there.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.control.stopping import max_change, slowed_together, stopping_speed, ticks_to_rest
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import clipped

__all__ = ["FAR", "Manoeuvre", "further"]

FAR = 1e9
"""A limit that is never felt."""
OUTSIDE = 1e-9
"""[rad or m] A joint less than this beyond its limit stands at it: rounding is no excursion."""


def further(ticks: ca.SX) -> ca.SX:
    """Ticks of the present velocity that are still gone in so many `ticks` of braking: F."""
    n = ca.floor(ticks)
    return n - n * (n + 1) / (2 * ca.fmax(ticks, 1e-12))


class Manoeuvre:
    """Braking of a chain at ticks of dt [s], and what a joint may do so that it can still brake.

    Parameters
    ----------
    chain : its limits of position, velocity and acceleration. dt : tick [s].
    recovery_speed : share of the velocity limit at which a joint outside its limits comes back.
    """

    def __init__(self, chain: SerialChain, dt: float, *, recovery_speed: float) -> None:
        self.dt, self.speed, self.change = dt, ca.DM(chain.velocity), max_change(chain, dt)
        self.low, self.high = ca.DM(np.maximum(chain.lower, -FAR)), ca.DM(np.minimum(chain.upper, FAR))
        self.back = recovery_speed * self.speed

    def ticks(self, velocity: ca.SX) -> ca.SX:
        """N"""
        return ticks_to_rest(velocity, self.change)

    def braked(self, velocity: ca.SX) -> ca.SX:
        """(n,) velocities after one tick of braking."""
        return slowed_together(velocity, self.change)

    def stop(self, q: ca.SX, velocity: ca.SX, ticks: ca.SX) -> ca.SX:
        """(n,) where joints are that keep the velocity (n,) for a tick, and then for so many more ticks of the way."""
        return clipped(q + self.dt * velocity * (1 + ticks), ca.fmin(self.low, q), ca.fmax(self.high, q))

    def intervals(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """(n,) each: lowest and highest velocities after which each joint still stops at its limit; never empty.

        The first two are what may be commanded now, the others without accelerations.

        Velocity never yields; then no joint is led beyond, or further beyond, its limit; then accelerations hold.
        """
        dt, speed = self.dt, self.speed
        ends = []
        for sign, room in ((-1, q - self.low), (1, self.high - q)):
            back = -ca.fmin(self.back, ca.fmax(-room, 0) / dt)
            ends.append(sign * ca.if_else(room < -OUTSIDE, back, stopping_speed(room, self.change, dt)))
        least, most = ca.fmax(last - self.change, -speed), ca.fmin(last + self.change, speed)
        hard = [sign * ca.fmin(ca.fmax(room / dt, 0), speed) for sign, room in ((-1, q - self.low), (1, self.high - q))]
        lower, upper = (clipped(clipped(end, least, most), *hard) for end in ends)
        return lower, upper, ca.fmax(ends[0], -speed), ca.fmin(ends[1], speed)

    def outside(self, q: ca.SX) -> ca.SX:
        """Whether a joint is beyond its limit."""
        return ca.sum1(ca.logic_or(q > self.high + OUTSIDE, q < self.low - OUTSIDE)) > 0
