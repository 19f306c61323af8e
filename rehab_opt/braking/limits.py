"""What a command and braking behind it have to keep: each limit one object, and one loop over all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.braking.manoeuvre import Manoeuvre, further
from rehab_opt.control.limit import Limit, smallest_rows
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.qrqp import qrqp
from rehab_opt.optim.rows import MAX_MAGNITUDE

__all__ = [
    "Bound",
    "HandSpeed",
    "JointAcceleration",
    "JointSpeed",
    "Kept",
    "Rows",
    "Way",
    "largest_part",
    "within_rows",
]

ROUNDING = 1e-10
PLACES = (0.0, 0.5, 1.0)
"""Of the way to rest, where a limit of the posture has its rows."""
WAY = 6
"""Places on the way to rest where it is judged."""
ROWS = 3
"""Of the distances of one limit, how many have rows: the least ones."""
CLEAR, BEND = 5e-5, 10.0
"""[rad], [1/rad] Margin that rows keep before a limit, in joint motion: its least, and what tangents miss a tick."""
PUSH, LEAVING = 0.3, 10.0
"""Share of what lacks of the margin that is regained a tick; weight of doing so [m^2/s^2]."""


class Way(NamedTuple):
    """A command and the braking behind it, as expressions."""

    q: ca.SX
    """(n,) joint positions now."""
    last: ca.SX
    """(n,) velocity before."""
    u: ca.SX
    """(n,) the command."""
    ticks: ca.SX
    """F of the command."""
    jacobian: ca.SX
    """(6, n) at q."""


class Bound(ABC):
    """A limit."""

    def at_most(self, way: Way) -> ca.SX:
        """(m,) zero or below only where `excess` is, and evaluated sooner where that can be."""
        return self.excess(way)

    @abstractmethod
    def excess(self, way: Way) -> ca.SX:
        """(k,) by how much it is passed; zero or below where it is kept."""


class JointSpeed(Bound):
    """|u_i| <= v_i"""

    def __init__(self, manoeuvre: Manoeuvre) -> None:
        self._speed = manoeuvre.speed

    def excess(self, way: Way) -> ca.SX:
        """(n,) [rad/s]"""
        return ca.fabs(way.u) - self._speed


class JointAcceleration(Bound):
    """|u_i - last_i| <= a_i dt"""

    def __init__(self, manoeuvre: Manoeuvre) -> None:
        self._change = manoeuvre.change

    def excess(self, way: Way) -> ca.SX:
        """(n,) [rad/s]"""
        return ca.fabs(way.u - way.last) - self._change * (1 + 1e-9)


class HandSpeed(Bound):
    """|J_v u| <= linear and |J_w u| <= angular, now, after the tick, and half the way to rest at half the speed."""

    def __init__(self, chain: SerialChain, manoeuvre: Manoeuvre, *, linear: float, angular: float) -> None:
        self._chain, self._manoeuvre, self._most = chain, manoeuvre, (linear, angular)
        rows, tool = chain.rows, float(np.linalg.norm(chain.tool[:3, 3]))
        slides = np.minimum(np.maximum(np.abs(chain.lower), np.abs(chain.upper)), MAX_MAGNITUDE)
        lengths = [r.across + abs(r.along) + s * r.prismatic for r, s in zip(rows, slides, strict=True)]
        arms = [rows[i].across + sum(lengths[i + 1 :]) + tool for i in range(chain.n)]
        self._longest = ca.DM(np.maximum(arms, 1.0) if any(row.prismatic for row in rows) else arms)

    def over(self, twist: ca.SX) -> ca.SX:
        """Speeds of a twist (6,) over their limits."""
        return ca.fmax(ca.norm_2(twist[:3]) / self._most[0], ca.norm_2(twist[3:]) / self._most[1])

    def part(self, jacobian: ca.SX, a: ca.SX, b: ca.SX) -> ca.SX:
        """Largest part, of at most 1, of velocities b (n,) that may be added to a (n,)."""
        twists = jacobian @ ca.horzcat(a, b)
        linear, angular = (
            largest_part(twists[i : i + 3, 0], twists[i : i + 3, 1], most)
            for i, most in ((0, self._most[0]), (3, self._most[1]))
        )
        return ca.fmin(linear, angular)

    def at_most(self, way: Way) -> ca.SX:
        """What `excess` does not exceed, from J(q) alone.

        A motion d of the joints changes J_v u by at most (|d_1| + ... + |d_n|) (r_1 |u_1| + ... + r_n |u_n|) with r_i
        the longest column of J_v at any posture, and J_w u by as much with 1 for r_i.
        """
        dt, size = self._manoeuvre.dt, ca.fabs(way.u)
        tick, over = dt * ca.sum1(size), []
        for rows, longest, most in ((slice(3), self._longest, self._most[0]), (slice(3, 6), 1.0, self._most[1])):
            now, bend = ca.norm_2((way.jacobian @ way.u)[rows]), tick * ca.sum1(longest * size)
            over.append(ca.fmax(now + bend, 0.5 * (now + bend * (1 + way.ticks / 2))) / most - 1)
        return ca.vertcat(*over)

    def excess(self, way: Way) -> ca.SX:
        """(3,)"""
        place, jacobian = self._manoeuvre.place, self._chain.jacobian_expression
        later = [(place(way.q, way.u, 0), 1.0), (place(way.q, way.u, way.ticks / 2), 0.5)]
        twists = [way.jacobian @ way.u, *(jacobian(q) @ (share * way.u) for q, share in later)]
        return ca.vertcat(*(self.over(twist) - 1 for twist in twists))


class Rows(NamedTuple):
    """away s - slopes u <= upper: tangents of h on the way to rest; s in [0, 1] says how fast a margin is regained."""

    slopes: ca.SX
    away: ca.SX
    upper: ca.SX
    values: ca.SX
    """(m,) h at the places where the tangents are taken, of braking."""
    levers: ca.SX
    """(m,) [s] by which u moves these places."""


class Kept(Bound):
    """h(q) >= 0 of a user's `Limit`s, after the tick and on the way to rest.

    Judged at `WAY` places, between two of them at the lowest of a parabola through three.
    """

    def __init__(self, limits: Sequence[Limit], chain: SerialChain, manoeuvre: Manoeuvre) -> None:
        self._limits, self._chain, self._manoeuvre = tuple(limits), chain, manoeuvre
        z, tables = ca.SX.sym("z", chain.n), [ca.SX(0, 1 + chain.n)]
        for each in self._limits:
            h = each.at(chain, z)
            tables.append(smallest_rows(ca.horzcat(h, ca.jacobian(h, z)), min(ROWS, h.numel())))
        self._tangents = ca.Function("tangents", [z], [ca.vertcat(*tables)])

    def __len__(self) -> int:
        return int(self._tangents.size1_out(0)) * len(PLACES)

    def _h(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *(each.at(self._chain, q) for each in self._limits))

    def outside(self, q: ca.SX) -> ca.SX:
        """Whether one is below zero at q (n,)."""
        return ca.mmin(ca.vertcat(0, self._h(q))) < -ROUNDING

    def excess(self, way: Way) -> ca.SX:
        """(k,) in the limits' own units."""
        place = self._manoeuvre.place
        h = [self._h(place(way.q, way.u, way.ticks * k / WAY)) for k in range(WAY + 1)]
        over = [-each for each in h]
        for a, b, c in zip(h, h[1:], h[2:], strict=False):
            fall, bow = ca.fmax(3 * a - 4 * b + c, 0), ca.fmax(a - 2 * b + c, 1e-12)
            over.append(-ca.if_else(fall < 4 * bow, a - 1.1 * fall**2 / (8 * bow), c))
        return ca.vertcat(*over)

    def rows(self, q: ca.SX, last: ca.SX, brake: ca.SX, least: ca.SX, most: ca.SX) -> Rows:
        """About the command `brake` (n,), which keeps them, of commands from `least` to `most` (n,)."""
        one, ticks, found = self._manoeuvre, self._manoeuvre.ticks(last), []
        for part in PLACES:
            lever = one.dt * (1 + part * further(ticks + 1))
            table = self._tangents(one.place(q, brake, part * further(ca.fmax(ticks - 1, 0))))
            h, slopes = table[:, 0], table[:, 1:]
            margin = (CLEAR + BEND * (lever * ca.norm_2(one.change)) ** 2) * ca.sqrt(ca.sum2(slopes**2))
            can = lever * (ca.fmax(slopes, 0) @ (most - brake) + ca.fmin(slopes, 0) @ (least - brake))
            away = ca.fmax(ca.fmin(PUSH * (margin - h), 0.5 * can), 0) / lever
            upper = ca.fmax(h - margin, 0) / lever - slopes @ brake
            found.append(Rows(slopes, away, upper, h, lever * ca.SX.ones(h.numel())))
        return Rows(*(ca.vertcat(*column) for column in zip(*found, strict=True)))

    def bent(self, rows: Rows, q: ca.SX, brake: ca.SX, u: ca.SX) -> ca.SX:
        """(m,) upper ends less what the tangents promise too much of the command u (n,); `brake` (n,) keeps them."""
        ticks = further(self._manoeuvre.ticks(u))
        places = [self._manoeuvre.place(q, u, part * ticks) for part in PLACES]
        true = ca.vertcat(*(self._tangents(each)[:, 0] for each in places))
        missed = ca.fmax((rows.values - true) / rows.levers + rows.slopes @ (u - brake), 0)
        return ca.fmax(rows.upper - missed, -rows.slopes @ brake)


def largest_part(a: ca.SX, b: ca.SX, most: float) -> ca.SX:
    """Largest part, of at most 1, of b that may be added to a until it is longer than `most`."""
    bb, ab, room = ca.fmax(ca.sumsqr(b), 1e-18), ca.dot(a, b), ca.fmax(most**2 - ca.sumsqr(a), 0)
    return ca.fmin((ca.sqrt(ab**2 + bb * room) - ab) / bb, 1)


def within_rows(n: int, m: int) -> ca.Function:
    """H, u (n,), slopes, away, upper (m,), least, most (n,) -> nearest to u within the rows and the interval.

    min |x - u|_H^2 + LEAVING (1 - s)^2  s.t. away s - slopes x <= upper, least <= x <= most, 0 <= s <= 1
    """
    shapes = {
        "H": (n, n),
        "u": (n, 1),
        "slopes": (m, n),
        "away": (m, 1),
        "upper": (m, 1),
        "least": (n, 1),
        "most": (n, 1),
    }
    H, u, slopes, away, upper, least, most = given = [ca.MX.sym(name, *shape) for name, shape in shapes.items()]
    found = qrqp("within_rows", n + 1, m)(
        h=ca.densify(ca.diagcat(H, LEAVING)), g=ca.vertcat(-H @ u, -LEAVING), a=ca.horzcat(-slopes, away),
        lba=-ca.inf * ca.DM.ones(m), uba=upper, lbx=ca.vertcat(least, 0), ubx=ca.vertcat(most, 1), x0=ca.vertcat(u, 0),
    )["x"][:n]  # fmt: skip
    found = ca.if_else(ca.sumsqr(found) < ca.inf, found, u)  # NaN is no answer
    return ca.Function("within_rows", given, [ca.fmin(ca.fmax(found, least), most)])
