"""A user's own limit on an arm's posture: stated once, kept by the QP, the shortened step and the safe command."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from rehab_opt.control.stopping import VelocityBounds, nearest_to_rest
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["Limit", "Limits", "checked_limits"]

ROUNDING = 1e-13
"""[rad, m] of a joint, by which rounding may take a distance further below zero."""
PARTS = (0.75, 0.5, 0.25)
"""Of the way from braking to the QP's answer, and of braking itself, that are tried where those lead beyond a limit."""
PASSES = 2
"""Over all limits, in which a velocity is looked for that keeps them."""
START = 0.1
"""Share of the largest speeds that a joint may reach in a tick and still be met by the margin, however fast it gets."""
MATTERS = 0.05
"""Of a slope's largest entry: a joint below it is not asked to keep a limit."""
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Limit:
    """What a posture has to keep: every distance h(q) at zero or above, at the end of every tick.

    h(q) >= 0, met as the barrier  grad h . q' >= -rate h

    Parameters
    ----------
    distances : chain, joint positions (n,) -> (k,) distances h(q) as CasADi expressions, in any unit. Smooth where they
        are small; of several the two least make rows of the QP, all of them are judged at the end of the tick.
        Where they, or their slopes, are no numbers, nothing is certified.
    rate : [1/s] at which the least distance may decay; by default 1/T, T the longest of the joints' speeds over their
        accelerations, so that all joints can brake together before it.
    """

    distances: Callable[[SerialChain, ca.SX], ca.SX]
    rate: float | None = None

    def at(self, chain: SerialChain, q: ca.SX) -> ca.SX:
        """(k,) the distances at q (n,)."""
        return ca.densify(ca.vec(ca.SX(self.distances(chain, q))))

    def count(self, chain: SerialChain) -> int:
        """How many of the distances make a row of the QP: the two least, which an edge of two is slid along with."""
        return min(self.at(chain, ca.SX.sym("q", chain.n)).numel(), 2)

    def nearest(self, chain: SerialChain, q: ca.SX, way: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The least distances at q (n,), one or two, how they change with q (k, n), and what of them `way` (n,) loses.

        That is what a distance is below its tangent after `way`, zero where it is above.
        """
        symbol, ahead = ca.SX.sym("q", chain.n), ca.SX.sym("ahead", chain.n)
        each = self.at(chain, symbol)
        first, *others = ca.vertsplit(ca.densify(ca.horzcat(each, self.at(chain, ahead), ca.jacobian(each, symbol))))
        second = ca.SX(0, first.numel())
        for other in others:
            closer = other[0] < first[0]
            further, first = ca.if_else(closer, first, other), ca.if_else(closer, other, first)
            second = ca.if_else(further[0] < second[0], further, second) if second.numel() else further
        found = ca.Function("nearest", [symbol, ahead], [ca.vertcat(first, second)])(q, q + way)
        least, then, slopes = found[:, 0], found[:, 1], found[:, 2:]
        return least, slopes, ca.fmax(least + slopes @ way - then, 0)


def checked_limits(limits: Sequence[Limit], chain: SerialChain) -> tuple[Limit, ...]:
    """The limits, each tried on the chain.

    Raises
    ------
    ConfigurationError : no list of `Limit`, distances that are no expression of the joint positions, a rate that is not
        above zero.
    """
    if not isinstance(limits, (list, tuple)) or not all(isinstance(each, Limit) for each in limits):
        raise ConfigurationError("limits", limits, "a list or tuple of Limit")
    for i, each in enumerate(limits):
        if not (each.rate is None or (isinstance(each.rate, (int, float)) and 0 < each.rate < np.inf)):
            raise ConfigurationError(f"limits[{i}].rate", each.rate, "a number above zero, or None")
        q = ca.SX.sym("q", chain.n)
        try:
            column = each.at(chain, q)
            ca.Function("limit", [q], [column])  # other symbols are refused
        except (TypeError, ValueError, AttributeError, IndexError, RuntimeError, NotImplementedError) as problem:
            expected = f"an expression of q ({' '.join(str(problem).split())[:200]})"
            raise ConfigurationError(f"limits[{i}].distances", each.distances, expected) from problem
        if not column.numel() or not ca.depends_on(column, q):
            raise ConfigurationError(f"limits[{i}].distances", column, "an expression that depends on q")
    return tuple(limits)


class Limits:
    """The limits of one arm in one tick.

    A row is about the tangent at the beginning of a tick, and the arm is judged at its end. So what the last velocity
    would lose against the tangent is counted on, and a margin is kept, about the square of the joints' way in a tick:
    nearer than that the row leads the arm away again, so that it slides along a curved limit and does not stick. Limits
    come before accelerations, also while braking, and after speeds and joint limits.

    Parameters
    ----------
    limits : what `checked_limits` gives. chain : the arm. dt : tick [s].
    """

    def __init__(self, limits: Sequence[Limit], chain: SerialChain, dt: float) -> None:
        self.limits, self.chain, self.dt = tuple(limits), chain, dt
        together = max(float(np.max(chain.velocity / chain.acceleration)), dt)
        rates = [
            1 / together if each.rate is None else each.rate for each in self.limits for _ in range(each.count(chain))
        ]
        self._shares = ca.DM([(1 - np.exp(-rate * dt)) / dt for rate in rates])
        self._begun = float(np.sum(np.minimum(chain.acceleration * dt, START * chain.velocity)))

    def __len__(self) -> int:
        """How many rows they make."""
        return self._shares.numel()

    def rows(self, q: ca.SX, last: ca.SX, bounds: VelocityBounds) -> tuple[ca.SX, ca.SX, VelocityBounds]:
        """R (m, n), r (m,) of R q' <= r, and the intervals, opened where acceleration has to yield.

        There is always a velocity that keeps them all: looked for between the intervals' ends, and where none of those
        keeps a distance above zero, beyond them.
        """
        rest = nearest_to_rest(bounds._replace(brake_lower=bounds.lower, brake_upper=bounds.upper))
        slopes, free, _ = now = self._now(q, last)
        kept = _kept_within(now, rest, (bounds.lower, bounds.upper), bounds)
        opened = bounds._replace(lower=ca.fmin(bounds.lower, kept), upper=ca.fmax(bounds.upper, kept))
        return -slopes, ca.fmax(free, -slopes @ kept), opened

    def falls(self, q: ca.SX, last: ca.SX, *, room: Callable[[ca.SX], ca.SX] | None = None) -> tuple[ca.SX, ca.SX]:
        """Slopes (m, n) of the least distances, and how fast they may fall (m,): below zero where they have to rise.

        What is beyond a limit is taken for at it: it goes no further, and is not led back. `room` says, of the slopes,
        what is left before each (m,).
        """
        slopes, least, spent = self._tangents(q, last)
        least = least if room is None else least - room(slopes)
        return slopes, self._shares * ca.fmax(least, 0) - spent

    def braking(self, q: ca.SX, last: ca.SX, bounds: VelocityBounds) -> ca.SX:
        """(n,) the velocity nearest to rest, but for joints that hold theirs longer where a limit wants it."""
        rest = nearest_to_rest(bounds)
        held = clipped(last, bounds.brake_lower, bounds.brake_upper)
        slower = _kept_within(self._now(q, last), rest, (ca.fmin(rest, held), ca.fmax(rest, held)), bounds)
        return self.keeping(q, slower, slower)

    def keeping(self, q: ca.SX, wanted: ca.SX, braking: ca.SX) -> ca.SX:
        """(n,) the first that leads beyond no limit: `wanted`, parts of the way there from `braking`, parts of that."""
        chosen = ca.SX.zeros(self.chain.n)
        slower = [part * braking for part in reversed(PARTS)]
        between = [braking + part * (wanted - braking) for part in (0.0, *reversed(PARTS))]
        for u in (*slower, *between, wanted):
            chosen = ca.if_else(self.kept(q, u), u, chosen)
        return chosen

    def kept(self, q: ca.SX, velocity: ca.SX) -> ca.SX:
        """1 where a velocity leads no distance below zero, nor further below; NaN fails."""
        conditions = []
        for each in self.limits:
            now, then = each.at(self.chain, q), each.at(self.chain, q + velocity * self.dt)
            slope = ca.norm_2(each.nearest(self.chain, q, ca.SX.zeros(self.chain.n))[1][0, :])
            conditions.append(then >= ca.fmin(now, 0) - ROUNDING * slope)
        return all_true(*conditions)

    def _now(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Slopes (m, n) of the least distances, how fast they may fall, and may not but in this tick (m,)."""
        slopes, least, spent = self._tangents(q, last)
        return slopes, self._shares * least - spent, ca.fmax(least, 0) / self.dt

    def _tangents(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Slopes (m, n) of the least distances, these (m,), and what of their fall the tangents do not tell (m,).

        That is what the last velocity would lose against them in this tick, and what leads to a margin for what a
        change of it may lose more. Nearer than the margin, what lacks of it is asked for in this tick: an arm that
        stands at a limit is free to begin to move along it.
        """
        found = [each.nearest(self.chain, q, self.dt * last) for each in self.limits]
        least, slopes, lost = (ca.vertcat(*column) for column in zip(*found, strict=True))
        way, begun = self.dt * ca.sum1(ca.fabs(last)), self.dt * self._begun
        margin = ca.sqrt(ca.sum2(slopes**2)) * (way + begun / 2) * begun
        lacking = clipped(margin - least, 0, margin)
        return slopes, least, self._shares * (margin - lacking) + (lacking + lost) / self.dt


def _kept_within(
    now: tuple[ca.SX, ca.SX, ca.SX], rest: ca.SX, ends: tuple[ca.SX, ca.SX], bounds: VelocityBounds
) -> ca.SX:
    """(n,) `rest`, moved limit by limit towards the end of an interval that keeps it, as far as it asks.

    What still leads below zero in this tick is taken away across that limit, within the bounds that never yield,
    and if that is not enough, of all joints alike: only there acceleration yields.
    """
    (lower, upper), (slopes, free, hard) = ends, now
    u = rest
    for i in list(range(slopes.size1())) * PASSES:
        slope = slopes[i, :].T
        matters = ca.fabs(slope) > MATTERS * ca.mmax(ca.fabs(slope))
        end = ca.if_else(matters, ca.if_else(slope > 0, upper, lower), u)
        over, most = -ca.dot(slope, u) - free[i], ca.dot(slope, end - u)
        u += ca.if_else(over > 0, ca.fmin(over / ca.fmax(most, TINY), 1), 0) * (end - u)
    for i in list(range(slopes.size1())) * PASSES:
        slope = slopes[i, :].T
        over = ca.fmax(-ca.dot(slope, u) - hard[i], 0)
        u = ca.if_else(
            over > 0,
            clipped(u + slope * (over / ca.fmax(ca.sumsqr(slope), TINY)), bounds.hard_lower, bounds.hard_upper),
            u,
        )
    closing = -slopes @ u
    return ca.fmin(1, ca.mmin(ca.if_else(closing > hard, hard / ca.fmax(closing, TINY), 1))) * u
