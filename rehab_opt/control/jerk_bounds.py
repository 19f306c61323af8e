"""Velocity interval of each joint in this tick for drives with bounded jerk; never empty.

A tick chooses the velocity u after the last velocity v and the last change a = (v - v_before)/dt. In this and all later
ticks, finite differences satisfy

    |u| <= V,   |u - v| <= A dt,   |u - v - a dt| <= J dt^2,   lower <= q + u dt <= upper,

with the bounds V, A and J of velocity, acceleration and jerk. The state after u can stop if a continuous-time stop
exists from u with an initial acceleration b, |b - (u - v)/dt| <= J dt/2. The stopping distance is convex in u, so two
successive chords bound it on the safe side. A position limit is relaxed only if no velocity can satisfy it any more;
the other bounds never are.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.stopping import FAR, OUTSIDE, VelocityBounds, max_change
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.optim.certificate import clipped

__all__ = ["JerkBounds"]

Array = NDArray[np.float64]

MARGIN = 0.03
"""Margin before a limit as a fraction of J dt^3; the largest margin that was ever needed is 0.0225."""
TINY = 1e-300


class JerkBounds(NamedTuple):
    """Bounds on the joint velocities of a chain whose drives have bounded jerk, at ticks of dt [s].

    `jerk` (n,) [rad/s^3 or m/s^3] is positive and finite. `recovery_speed` is the speed, as a fraction of the velocity
    limit, at which a joint outside its limits returns.
    """

    chain: SerialChain
    jerk: Array
    dt: float
    recovery_speed: float

    @classmethod
    def checked(cls, chain: SerialChain, jerk: ArrayLike, dt: float, recovery_speed: float) -> JerkBounds:
        """Bounds from a jerk, scalar or (n,); one that is not positive and finite raises `ConfigurationError`."""
        bound = per_joint("jerk", jerk, chain.n, finite=True)
        if not np.all(bound > 0):
            raise ConfigurationError("jerk", jerk, "positive numbers, or None for no bound")
        return cls(chain, bound, dt, recovery_speed)

    @property
    def fastest_gain(self) -> float:
        """Largest feedback rate [1/s] that the joints can follow while they build up acceleration."""
        built = np.minimum(self.chain.acceleration, np.sqrt(self.jerk * self.chain.velocity))
        return float(np.min(self.jerk / (4 * built)))

    @property
    def _change(self) -> ca.DM:
        return max_change(self.chain, self.dt) / self.dt

    @property
    def _jerk(self) -> ca.DM:
        return ca.fmin(ca.DM(self.jerk), 2 * self._change / self.dt)

    def interval(self, q: ca.SX, last: ca.SX, acceleration: ca.SX) -> VelocityBounds:
        """Velocity intervals at positions q, after the last velocities and last accelerations [rad/s^2], (n,) each.

        The braking interval is a single velocity: the one that begins the shortest stop.
        """
        dt, most, jerk = self.dt, self._change, self._jerk
        movable = ca.DM(~self.chain.locked)
        speed = ca.DM(self.chain.velocity)
        back = self.recovery_speed * speed
        calm = 0.5 * most / back  # the return ends gently
        low, high = (ca.DM(np.clip(each, -FAR, FAR)) for each in (self.chain.lower, self.chain.upper))
        above, below = q > high + OUTSIDE, q < low - OUTSIDE
        first = last + dt * clipped(acceleration - jerk * dt, -most, most)
        final = last + dt * clipped(acceleration + jerk * dt, -most, most)
        # Outside a limit the joint returns no faster than the recovery speed; a braking joint does not return.
        fast_up, fast_down = ca.if_else(below, back, speed), ca.if_else(above, back, speed)
        upper = clipped(self._up_to(last, fast_up), first, final)
        lower = clipped(-self._up_to(-last, fast_down), first, final)
        lower, upper = ca.fmin(lower, upper), ca.fmax(lower, upper)
        up, free_up = self._before(q, last, high, first, upper)
        down, free_down = self._before(-q, -last, -low, -final, -lower)
        rest_up, rest_down = self._up_to(last, 0), -self._up_to(-last, 0)
        led_up = self._up_to(last, -ca.fmin(back, calm * ca.fmax(q - high, 0)))
        led_down = -self._up_to(-last, -ca.fmin(back, calm * ca.fmax(low - q, 0)))
        brake_upper = ca.if_else(above, clipped(rest_up, first, upper), up)
        brake_lower = ca.if_else(below, clipped(rest_down, lower, final), -down)
        stop_upper = ca.if_else(above, led_up, ca.if_else(free_up, speed, up))
        stop_lower = ca.if_else(below, led_down, ca.if_else(free_down, -speed, -down))
        # The return has a lower priority than ending the acceleration in time for the recovery or largest speed.
        lower, upper = (
            ca.if_else(below, clipped(led_down, lower, upper), -down),
            ca.if_else(above, clipped(led_up, lower, upper), up),
        )
        lower, upper = ca.fmin(lower, upper), ca.fmax(lower, upper)
        rest = ca.if_else(last >= 0, rest_down, rest_up)
        rest = clipped(rest, ca.fmin(brake_lower, brake_upper), ca.fmax(brake_lower, brake_upper))
        kept = [movable * clipped(each, -speed, speed) for each in (lower, upper, rest)]
        return VelocityBounds(
            lower=kept[0],
            upper=kept[1],
            brake_lower=kept[2],
            brake_upper=kept[2],
            stop_lower=movable * stop_lower,
            stop_upper=movable * stop_upper,
            outside=ca.sum1(ca.logic_or(above, below)) > 0,
            hard_lower=kept[0],
            hard_upper=kept[1],
        )

    def towards(self, last: ca.SX, lower: ca.SX, upper: ca.SX, unconstrained: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Interval from which no joint overshoots its unconstrained velocity while its acceleration ends."""
        slower = last <= unconstrained
        most = ca.if_else(slower, clipped(self._up_to(last, unconstrained), lower, upper), upper)
        least = ca.if_else(slower, lower, clipped(-self._up_to(-last, -unconstrained), lower, upper))
        return least, most

    def _up_to(self, last: ca.SX, ceiling: ca.SX | float) -> ca.SX:
        """(n,) largest velocity from which the acceleration can end before the velocity exceeds `ceiling`."""
        dt, jerk = self.dt, self._jerk
        room = ceiling - last - 0.5 * jerk * dt**2
        change = 0.5 * jerk * dt + jerk * (ca.sqrt(dt**2 + 2 * ca.fmax(room, 0) / jerk) - dt)
        return ca.if_else(room >= 0, last + dt * change, ceiling)

    def _before(self, q: ca.SX, last: ca.SX, limit: ca.DM, first: ca.SX, final: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Largest velocity (n,) from `first` to `final` that can stop before `limit`, and whether all of these can."""
        near = clipped(q, limit - MARGIN * self._jerk * self.dt**3, limit)  # a joint at rest within the margin may stay

        def beyond(u: ca.SX) -> ca.SX:
            return self._stop(u, last, q) - near

        def chord(u: ca.SX, least: ca.SX) -> ca.SX:
            return clipped(u - least * (final - u) / ca.fmax(most - least, TINY), first, final)

        least, most = beyond(first), beyond(final)
        u = chord(first, least)
        u = ca.if_else(least >= 0, first, chord(u, beyond(u)))  # a single chord brakes late
        return ca.if_else(most <= 0, final, u), most <= 0

    def _stop(self, u: ca.SX, last: ca.SX, q: ca.SX) -> ca.SX:
        """(n,) position at which the shortest stop after a tick of u ends or reverses."""
        dt, most, jerk = self.dt, self._change, self._jerk
        change = clipped((u - last) * (1 / dt), -most, most)
        root = ca.sqrt(2 * jerk * ca.fabs(u))
        ends = ca.if_else(u >= 0, -root, root)  # speed that a single jerk brings to rest
        a = clipped(clipped(ends, change - 0.5 * jerk * dt, change + 0.5 * jerk * dt), -most, most)
        turning = ca.if_else(u > 0, root**3 / (6 * jerk**2), 0)
        p = ca.fmin(ca.sqrt(ca.fmax(jerk * u + 0.5 * a**2, 0)), most)
        fall = ca.fmax((a + p) / jerk, 0)
        slower = u + a * fall - 0.5 * jerk * fall**2
        hold = ca.if_else(p >= most, ca.fmax(slower / most - 0.5 * most / jerk, 0), 0)
        way = fall * (u + fall * (0.5 * a - jerk * fall / 6)) + hold * (slower - 0.5 * p * hold) + p**3 / (6 * jerk**2)
        further = u + 0.5 * a * ca.fabs(a) / jerk > 0
        way = ca.if_else(further, ca.fmax(way, 0), turning)
        # A velocity that is held for each tick travels half a tick further; the second term is the sum's excess over
        # the integral.
        return q + 0.5 * dt * u - dt**2 / 12 * a + way
