"""Limits of a command and of the braking after it: each limit is one object, and one loop checks all of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from rehab_opt.control.clearance_pairs import ClearancePairs
from rehab_opt.control.limit import SLACK, Limit, smallest_rows
from rehab_opt.control.manoeuvre import Manoeuvre, further
from rehab_opt.control.stopping import OUTSIDE
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import MOVING
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.tick import Stages

__all__ = [
    "Bodies",
    "Bound",
    "HandSpeed",
    "JointAcceleration",
    "JointSpeed",
    "Kept",
    "Posture",
    "Rows",
    "State",
    "UserLimits",
    "Way",
]

ROUNDING = 1e-10
PLACES = (0.0, 1.0)
"""Fractions of the way to rest at which a limit of the posture has its rows."""
BRAKED = tuple(k / 8 for k in range(8))
"""Fractions of the way to rest at which hand speeds are checked."""
FURTHEST = 2 / 3**1.5
"""Maximum of x sqrt(1 - x) for 0 <= x <= 1."""
CLEAR, BEND = 5e-5, 30.0
"""[rad] Least margin of rows before a limit, as a joint motion; [1/rad] factor of the tangents' error in a tick on the
squared motion of the stop posture.
"""
CLOSE = 2.0
"""Three points suffice to check h if the least of their three values is above this many times their spread."""
FLAT, ASIDE = 2e-3, 0.1
"""[1/rad] If h is below zero, a slope below `FLAT` is too small to show the way back; [rad or m] h is then
differentiated at a posture `ASIDE` away.
"""
PUSH = 0.3
"""Fraction of a missing margin to a limit that is regained per tick."""


class State(NamedTuple):
    """State of a tick, as expressions."""

    q: ca.SX
    """(n,) current joint positions."""
    last: ca.SX
    """(n,) last velocity."""
    jacobian: ca.SX
    """(6, n) Jacobian at q."""
    moving: ca.SX
    """Values of the moving capsules."""


class Way(NamedTuple):
    """A command and the braking after it, as expressions."""

    state: State
    u: ca.SX
    """(n,) command."""
    ticks: ca.SX
    """F: braking distance after the command, as a number of ticks at the command's velocity."""


class Bound(ABC):
    """Limit on a command and on the braking after it."""

    def at_most(self, tick: Stages, way: Way) -> ca.SX:
        """(m,) cheap upper bound of `excess`: if it is not positive, neither is `excess`."""
        return self.excess(tick, way)

    @abstractmethod
    def excess(self, tick: Stages, way: Way) -> ca.SX:
        """(k,) excess over the limit; not positive if the limit is satisfied."""


class JointSpeed(Bound):
    """|u_i| <= v_i"""

    def __init__(self, manoeuvre: Manoeuvre) -> None:
        self._speed = manoeuvre.speed

    def excess(self, tick: Stages, way: Way) -> ca.SX:
        """(n,) [rad/s]"""
        return ca.fabs(way.u) - self._speed


class JointAcceleration(Bound):
    """|u_i - last_i| <= a_i dt"""

    def __init__(self, manoeuvre: Manoeuvre) -> None:
        self._change = manoeuvre.change

    def excess(self, tick: Stages, way: Way) -> ca.SX:
        """(n,) [rad/s]"""
        return ca.fabs(way.u - way.state.last) - self._change * (1 + 1e-9)


class HandSpeed(Bound):
    """|J_v u| <= linear and |J_w u| <= angular, now, after the tick, and on the way to rest.

    J_v, J_w : linear and angular Jacobian. At a fraction x of the way to rest, the speed has fallen to the
        fraction sqrt(1 - x).
    """

    def __init__(self, chain: SerialChain, manoeuvre: Manoeuvre, *, linear: float, angular: float) -> None:
        self._chain, self._manoeuvre, self._most = chain, manoeuvre, (linear, angular)
        rows, tool = chain.rows, float(np.linalg.norm(chain.tool[:3, 3]))
        slides = np.minimum(np.maximum(np.abs(chain.lower), np.abs(chain.upper)), MAX_MAGNITUDE)
        lengths = [r.across + abs(r.along) + s * r.prismatic for r, s in zip(rows, slides, strict=True)]
        arms = [rows[i].across + sum(lengths[i + 1 :]) + tool for i in range(chain.n)]
        self.reach = rows[0].across + abs(rows[0].along) + slides[0] * rows[0].prismatic + sum(lengths[1:]) + tool
        """[m] Upper bound of the tool's distance from the base."""
        self._longest = ca.DM(np.maximum(arms, 1.0) if any(row.prismatic for row in rows) else arms)

    def over(self, twist: ca.SX) -> ca.SX:
        """Ratio of a twist's (6,) linear or angular speed to its limit, whichever ratio is larger."""
        return ca.fmax(ca.norm_2(twist[:3]) / self._most[0], ca.norm_2(twist[3:]) / self._most[1])

    def part(self, jacobian: ca.SX, a: ca.SX, b: ca.SX) -> ca.SX:
        """Largest fraction, at most 1, of velocities b (n,) that may be added to a (n,) within both hand speeds."""
        twists = jacobian @ ca.horzcat(a, b)
        linear, angular = (
            largest_part(twists[i : i + 3, 0], twists[i : i + 3, 1], most)
            for i, most in ((0, self._most[0]), (3, self._most[1]))
        )
        return ca.fmin(linear, angular)

    def at_most(self, tick: Stages, way: Way) -> ca.SX:
        """Upper bound of `excess`, from J(q) only.

        A joint motion d changes J_v u by at most sum|d_i| sum(r_i |u_i|). Here r_i is the longest column of J_v at any
        posture; for J_w u it is 1.
        """
        size, over = ca.fabs(way.u), []
        turned = self._manoeuvre.dt * ca.sum1(size)
        for rows, longest, most in ((slice(3), self._longest, self._most[0]), (slice(3, 6), 1.0, self._most[1])):
            now, bend = ca.norm_2((way.state.jacobian @ way.u)[rows]), turned * ca.sum1(longest * size)
            over.append((now + bend * (1 + FURTHEST * way.ticks)) / most - 1)
        return ca.vertcat(*over)

    def excess(self, tick: Stages, way: Way) -> ca.SX:
        """(9,) ratios of speed to limit, minus 1."""
        place, jacobian = self._manoeuvre.place, self._chain.jacobian_expression
        later = [(place(way.state.q, way.u, way.ticks * x), math.sqrt(1 - x)) for x in BRAKED]
        twists = [way.state.jacobian @ way.u, *(jacobian(q) @ (share * way.u) for q, share in later)]
        return ca.vertcat(*(self.over(twist) - 1 for twist in twists))


class Rows(NamedTuple):
    """QP rows away s - slopes u <= upper: tangents of h on the way to rest.

    The QP's variable s in [0, 1] says which fraction of the rates `away` is used to regain a missing margin.
    """

    slopes: ca.SX
    away: ca.SX
    upper: ca.SX
    values: ca.SX
    """(m,) h at the points of the tangents, on the braking path."""
    levers: ca.SX
    """(m,) [s] derivative of these points by u."""


class Posture(Protocol):
    """Limits h(q, t) >= 0 of the posture q, after bodies have moved for t [s]; `moving` holds the bodies' values."""

    places: int
    """Number of equal sections of the way to rest whose ends are checked."""
    rates: list[float | None]
    """(m,) [1/s] largest decay rate of each of the least distances; None: as fast as braking allows."""

    def h(self, tick: Stages, q: ca.SX, t: ca.SX, moving: ca.SX) -> ca.SX:
        """(k,) all distances."""

    def tangents(self, tick: Stages, q: ca.SX, t: ca.SX, state: State) -> ca.SX:
        """Table (m, 1 + n): the least distances, each with its gradient by q."""


class UserLimits:
    """Limits h(q) >= 0 that users define as `Limit`s."""

    places = 6

    def __init__(self, limits: Sequence[Limit], chain: SerialChain) -> None:
        self._limits, self._chain = tuple(limits), chain
        self.rates = [each.rate for each in self._limits for _ in range(each.count(chain))]
        q, way, tables = ca.SX.sym("q", chain.n), ca.SX.sym("way", chain.n), []
        for each in self._limits:
            h, slopes = each.at(chain, q), each.slopes(chain, q)
            seconds = 0.0 if each.rate is None else 1 / each.rate
            ahead = h + seconds * (slopes @ way)  # a distance that falls at its rate is among the least
            table = smallest_rows(ca.horzcat(ahead, h, slopes), each.count(chain))
            tables.append(table[:, 1:])
        self._tangents = ca.Function("tangents", [q, way], [ca.vertcat(*tables)])

    def h(self, tick: Stages, q: ca.SX, t: ca.SX, moving: ca.SX) -> ca.SX:
        """(k,) distances in the limits' own units."""
        return ca.vertcat(*(each.at(self._chain, q) for each in self._limits))

    def tangents(self, tick: Stages, q: ca.SX, t: ca.SX, state: State) -> ca.SX:
        """Table (m, 1 + n): the `Limit.count` least values of each limit, each with its gradient by q."""
        return self._tangents(q, state.last)


class Bodies:
    """Limits d(q, t) - margin >= 0 [m] for the pairs of a `Clearance`; moving capsules keep their velocity."""

    places = 2

    def __init__(self, pairs: ClearancePairs) -> None:
        self._pairs, n = pairs, pairs.chain.n
        self.rates = [pairs.clearance.rate] * pairs.max_contacts
        q, told, t = ca.MX.sym("q", n), ca.MX.sym("moving", pairs.moving_size), ca.MX.sym("t")
        there = ca.reshape(told, MOVING, -1)
        if told.numel():
            there = ca.vertcat(there[:6, :] + t * there[6:12, :], there[6:, :])
        column = pairs.nearest(q, ca.MX.zeros(n), ca.vec(there), 0)
        k = pairs.max_contacts
        table = ca.horzcat(column[:k] - SLACK / 2, ca.reshape(column[2 * k : -1], k, n))
        self._tangents = ca.Function("tangents", [q, told, t], [table])

    def h(self, tick: Stages, q: ca.SX, t: ca.SX, moving: ca.SX) -> ca.SX:
        """(pairs,) [m] distances minus the margin."""
        return tick.call(self._pairs.distances, q, moving, t)[0]

    def tangents(self, tick: Stages, q: ca.SX, t: ca.SX, state: State) -> ca.SX:
        """Table (m, 1 + n): distances of the `Clearance.max_contacts` nearest contacts, each with its gradient by q."""
        return tick.call(self._tangents, q, state.moving, t)[0]


class Kept(Bound):
    """Limits h(q, t) >= 0 of all `kinds`, after the tick and on the way to rest.

    Between the checked points, h is checked at the minimum of a parabola through three points.
    """

    def __init__(self, kinds: Sequence[Posture], chain: SerialChain, manoeuvre: Manoeuvre) -> None:
        self._kinds, self._chain, self._manoeuvre = tuple(kinds), chain, manoeuvre
        rates, dt = [rate for each in self._kinds for rate in each.rates], manoeuvre.dt
        self._decays = ca.DM([1e9 if rate is None else -math.expm1(-rate * dt) / dt for rate in rates])

    def outside(self, tick: Stages, q: ca.SX, moving: ca.SX) -> ca.SX:
        """Whether any limit is violated at q (n,)."""
        return ca.mmin(ca.vertcat(0, *(each.h(tick, q, ca.SX(0), moving) for each in self._kinds))) < -OUTSIDE

    def excess(self, tick: Stages, way: Way) -> ca.SX:
        """(k,) excess in the limits' own units, for moving bodies at their positions at the end of the tick."""
        return ca.vertcat(ca.SX(0, 1), *(2 * ROUNDING - self._along(tick, each, way) for each in self._kinds))

    def _along(self, tick: Stages, kind: Posture, way: Way) -> ca.SX:
        """(k,) h at both ends and in the middle of the way to rest; if these are close to zero, h in between, too."""

        def at(part: float) -> ca.SX:
            place = self._manoeuvre.place(way.state.q, way.u, way.ticks * part)
            return kind.h(tick, place, ca.SX(self._manoeuvre.dt), way.state.moving)

        few = [at(part) for part in (0.0, 0.5, 1.0)]
        if kind.places == 2:
            return _with_parabolas(few)

        def all_of_them() -> ca.SX:
            known = dict(zip((0, kind.places // 2, kind.places), few, strict=True))
            return _with_parabolas([known[k] if k in known else at(k / kind.places) for k in range(kind.places + 1)])

        least, most = ca.fmin(ca.fmin(*few[:2]), few[2]), ca.fmax(ca.fmax(*few[:2]), few[2])
        more = [few[2]] * (2 * kind.places - len(few))
        return tick.when(all_true(least > CLOSE * (most - least)), ca.vertcat(*few, *more), all_of_them)

    def _tangents(self, tick: Stages, way: Way, part: float) -> ca.SX:
        """Tangents at the fraction `part` of the way to rest; bodies are where they will be when the arm gets there."""
        ticks, place = self._manoeuvre.ticks(way.state.last), self._manoeuvre.place
        seconds = self._manoeuvre.dt * (1 + (1 - math.sqrt(1 - part)) * ticks)
        there = place(way.state.q, way.u, part * way.ticks)
        return ca.vertcat(*(each.tangents(tick, there, seconds, way.state) for each in self._kinds))

    def far(self, tick: Stages, way: Way) -> ca.SX:
        """Whether a command and its braking stay so far from every limit that no rows are needed."""
        if any(rate is not None for each in self._kinds for rate in each.rates):
            return ca.SX(0)
        lever = self._manoeuvre.dt * (1 + way.ticks)
        return all_true(self.excess(tick, way) <= -self._margin(lever))

    def _margin(self, lever: ca.SX) -> ca.SX:
        dt = self._manoeuvre.dt
        return CLEAR + (dt**2 + BEND * (lever - dt) ** 2) * ca.sumsqr(self._manoeuvre.change)

    def no_rows(self) -> Rows:
        """Rows that are always satisfied."""
        m, n = len(PLACES) * self._decays.numel(), self._chain.n
        none = ca.SX.zeros(m)
        return Rows(ca.SX.zeros(m, n), none, ca.SX.ones(m), none, ca.SX.ones(m))

    def rows(self, tick: Stages, state: State, brake: ca.SX, least: ca.SX, most: ca.SX) -> Rows:
        """Rows for commands from `least` to `most`, linearised at the command `brake` (n,), which satisfies them."""
        one, ticks, found = self._manoeuvre, self._manoeuvre.ticks(state.last), []
        braking = Way(state, brake, further(ca.fmax(ticks - 1, 0)))
        tables = [self._tangents(tick, braking, part) for part in PLACES]
        tables[0] = tick.once(tables[0])
        flat = ca.logic_and(tables[0][:, 0] < -OUTSIDE, ca.sum2(tables[0][:, 1:] ** 2) < FLAT**2)

        def beside() -> ca.SX:
            way = braking._replace(state=state._replace(q=state.q + self._aside(state.q)))
            slopes = [self._tangents(tick, way, part)[:, 1:] for part in PLACES]
            return ca.vertcat(*(ca.horzcat(table[:, 0], each) for table, each in zip(tables, slopes, strict=True)))

        every = tick.when(ca.sum1(flat) > 0, beside, ca.vertcat(*tables))
        for part, table in zip(PLACES, ca.vertsplit(every, tables[0].size1()), strict=True):
            lever = one.dt * (1 + part * further(ticks + 1))
            h, slopes = table[:, 0], table[:, 1:]
            margin = self._margin(lever) * ca.sqrt(ca.sum2(slopes**2))
            can = lever * (ca.fmax(slopes, 0) @ (most - brake) + ca.fmin(slopes, 0) @ (least - brake))
            away = ca.fmax(ca.fmin(PUSH * (margin - h), 0.5 * can), 0) / lever
            away = ca.fmin(away, ca.fabs(slopes) @ one.back)
            upper = ca.fmax(h - margin, 0) / lever - slopes @ brake
            if part == 0:  # -dh/dt <= (1 - exp(-rate dt)) / dt h, or as braking needs
                upper = ca.fmin(upper, ca.fmax(self._decays * (h - lever * slopes @ brake), -slopes @ brake))
            found.append(Rows(slopes, away, upper, h, lever * ca.SX.ones(h.numel())))
        return Rows(*(ca.vertcat(*column) for column in zip(*found, strict=True)))

    def _aside(self, q: ca.SX) -> ca.SX:
        """(n,) step from q to a nearby posture where h has a slope, if h is below zero and flat at q."""
        size = ca.DM(np.linspace(0.5, 1, self._chain.n) * ASIDE)
        return size * ca.if_else(q + size > ca.DM(self._chain.upper), -1, 1)

    def bent(self, tick: Stages, rows: Rows, state: State, brake: ca.SX, u: ca.SX) -> ca.SX:
        """Upper bounds (m,) of the rows, less their linearisation error at u (n,), at least their values at `brake`."""
        way = Way(state, u, further(self._manoeuvre.ticks(u)))
        true = ca.vertcat(*(self._tangents(tick, way, part)[:, 0] for part in PLACES))
        missed = ca.fmax((rows.values - true) / rows.levers + rows.slopes @ (u - brake), 0)
        return ca.fmax(rows.upper - missed, -rows.slopes @ brake)


def _with_parabolas(h: Sequence[ca.SX]) -> ca.SX:
    lowest = []
    for a, b, c in zip(h, h[1:], h[2:], strict=False):
        fall, bow = ca.fmax(3 * a - 4 * b + c, 0), ca.fmax(a - 2 * b + c, 1e-12)
        lowest.append(ca.if_else(fall < 4 * bow, a - 1.1 * fall**2 / (8 * bow), c))
    return ca.vertcat(*h, *lowest)


def largest_part(a: ca.SX, b: ca.SX, most: float) -> ca.SX:
    """Largest fraction, at most 1, of vector b that can be added to vector a so that |sum| <= most."""
    bb, ab, room = ca.fmax(ca.sumsqr(b), 1e-18), ca.dot(a, b), ca.fmax(most**2 - ca.sumsqr(a), 0)
    return ca.fmin((ca.sqrt(ab**2 + bb * room) - ab) / bb, 1)
