"""Limits of a posture, and clearance: defined once, used by the QP, the shortened step and the fallback command."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.clearance import Clearance, checked_clearance
from rehab_opt.control.clearance_pairs import ClearancePairs, least
from rehab_opt.control.stopping import OUTSIDE, VelocityBounds
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import MovingCapsule, moving_numbers
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["Limit", "PostureLimits", "all_limits", "checked_limits"]

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""Allowed rounding below zero, in the distance's unit."""
PARTS = (0.75, 0.5, 0.25)
"""Fractions that are tried if a command violates a limit: of the step from the braking velocity to the command, then of
the braking velocity itself.
"""
NEAR = 1e-13
"""[m] Approach of bodies that counts as rounding."""
PASSES = 2
"""Number of passes over all limits in the search for a velocity that satisfies them."""
START = 0.1
"""The margin covers joints that accelerate from rest to this fraction of their largest speed in one tick."""
FLAT = 0.05
"""[m/rad] If the slope of a distance between bodies is below this, the return from within the margin slows down."""
SLACK = 1e-5
"""[m] Extra margin for bodies that lie along each other, whose distances curve."""
ROWS = 3
"""Largest number of distances of one limit that make QP rows: while an arm slides along the edge between two, it may
meet a third.
"""
MATTERS = 0.05
"""A joint is not used to satisfy a limit if its entry of the slope is below this fraction of the largest entry."""
RETURN = 0.01
"""[m/s] Speed of the return from within a margin for which acceleration limits are relaxed."""
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Limit:
    """Limit of the posture: every distance h(q) is zero or more at the end of every tick.

    h(q) >= 0, through the barrier grad h . q' >= -rate h;  `Relaxed.POSITION` reports that h(q) is below zero

    Parameters
    ----------
    distances : function of chain and joint positions (n,) that returns the distances h(q) (k,) as CasADi expressions,
        in any unit, smooth near zero. The three closest to zero, relative to their rate, make rows of the QP; all are
        checked at the end of the tick. A NaN stops the robot at once.
    rate : [1/s] largest decay rate of a distance; default 1/T, with the longest time T that any joint needs to stop.
    """

    distances: Callable[[SerialChain, ca.SX], ca.SX]
    rate: float | None = None

    def at(self, chain: SerialChain, q: ca.SX) -> ca.SX:
        """(k,) distances at q (n,)."""
        return ca.densify(ca.vec(ca.SX(self.distances(chain, q))))

    def slopes(self, chain: SerialChain, q: ca.SX) -> ca.SX:
        """(k, n) derivatives of the distances by q (n,)."""
        return ca.jacobian(self.at(chain, q), q)

    def count(self, chain: SerialChain) -> int:
        """Number of distances that make a row of the QP."""
        return min(self.at(chain, ca.SX.sym("q", chain.n)).numel(), ROWS)

    def nearest(self, chain: SerialChain, q: ca.SX, way: ca.SX, ways: float) -> tuple[ca.SX, ca.SX, ca.SX]:
        """At most three distances: those that will be smallest after the motion `way` (n,) is repeated `ways` times.

        Return their values at q (n,), their slopes (k, n), and their loss by curvature during one motion `way`.
        """
        symbol, ahead = ca.SX.sym("q", chain.n), ca.SX.sym("ahead", chain.n)
        each, then = self.at(chain, symbol), self.at(chain, ahead)
        rows = ca.horzcat(each + (then - each) * ways, each, then, self.slopes(chain, symbol))
        found = ca.Function("nearest", [symbol, ahead], [smallest_rows(rows, ROWS)])(q, q + way)
        least, then, slopes = found[:, 1], found[:, 2], found[:, 3:]
        return least, slopes, ca.fmax(least + slopes @ way - then, 0)


def smallest_rows(rows: ca.SX, k: int) -> ca.SX:
    """The k rows with the smallest first entries, in ascending order."""
    kept: list[ca.SX] = []
    for each in ca.vertsplit(ca.densify(rows)):
        row = each
        for i, other in enumerate(kept):
            closer = row[0] < other[0]
            kept[i], row = ca.if_else(closer, row, other), ca.if_else(closer, other, row)
        kept = [*kept, row][:k]
    return ca.vertcat(*kept)


def checked_limits(limits: Sequence[Limit], chain: SerialChain) -> tuple[Limit, ...]:
    """Check the limits by evaluating each once on the chain.

    Raises `ConfigurationError` for another type, a rate that is not positive, or distances that are not differentiable.
    """
    if not isinstance(limits, (list, tuple)) or not all(isinstance(each, Limit) for each in limits):
        raise ConfigurationError("limits", limits, "a list or tuple of Limit")
    for i, each in enumerate(limits):
        if not (each.rate is None or (isinstance(each.rate, (int, float)) and 0 < each.rate < np.inf)):
            raise ConfigurationError(f"limits[{i}].rate", each.rate, "a number above zero, or None")
        q = ca.SX.sym("q", chain.n)
        try:
            column = each.at(chain, q)
            ca.Function("limit", [q], [column])  # refuses other symbols
        except (TypeError, ValueError, AttributeError, IndexError, RuntimeError, NotImplementedError) as problem:
            expected = f"an expression of q ({' '.join(str(problem).split())[:200]})"
            raise ConfigurationError(f"limits[{i}].distances", each.distances, expected) from problem
        if not column.numel() or not ca.depends_on(column, q):
            raise ConfigurationError(f"limits[{i}].distances", column, "an expression that depends on q")
        for distance in ca.vertsplit(column):
            if ca.depends_on(distance, q) and ca.jacobian(distance, q).is_zero():
                expected = "an expression with a slope, to be kept at or above zero: a - b, not the comparison a > b"
                raise ConfigurationError(f"limits[{i}].distances", distance, expected)
    return tuple(limits)


def all_limits(
    limits: Sequence[Limit | Clearance], chain: SerialChain, dt: float, recovery_speed: float
) -> PostureLimits:
    """Limits of an arm, with at most one `Clearance`; errors as for `checked_limits` and `checked_clearance`."""
    if not isinstance(limits, (list, tuple)) or not all(isinstance(each, (Limit, Clearance)) for each in limits):
        raise ConfigurationError("limits", limits, "a list or tuple, each a Limit or a Clearance")
    found = [(f"limits[{i}]", each) for i, each in enumerate(limits) if isinstance(each, Clearance)]
    if len(found) > 1:
        raise ConfigurationError(found[1][0], found[1][1], "one Clearance with all bodies")
    pairs = [ClearancePairs(checked_clearance(name, each, chain), chain) for name, each in found]
    others = checked_limits([each for each in limits if isinstance(each, Limit)], chain)
    found_pairs = next((each for each in pairs if each.names), None)
    return PostureLimits(others, chain, dt, found_pairs, recovery_speed=recovery_speed)


class PostureLimits:
    """All `Limit`s and the clearance of one arm, in one tick.

    A row is the tangent of a distance at the beginning of a tick; the distance itself is checked at the end. Rows keep
    a margin of about the square of the joint motion in a tick. These limits take precedence over acceleration limits;
    speed limits and joint limits take precedence over them.

    Parameters
    ----------
    limits : from `checked_limits`. chain : the arm. dt : tick [s].
    clearance : pairs of a `Clearance`, or None; each contact makes a row, after the rows of the limits.
    recovery_speed : largest speed of the return into a limit, as a fraction of the joints' speeds.
    """

    def __init__(
        self,
        limits: Sequence[Limit],
        chain: SerialChain,
        dt: float,
        clearance: ClearancePairs | None = None,
        *,
        recovery_speed: float = 1.0,
    ) -> None:
        self.limits, self.chain, self.dt, self.clearance = tuple(limits), chain, dt, clearance
        self.moving = 0 if clearance is None else clearance.clearance.moving
        """Largest number of moving capsules in a tick."""
        self._calm = ca.DM(recovery_speed * chain.velocity)
        together = max(float(np.max(chain.velocity / chain.acceleration)), dt)
        rates = [each.rate for each in self.limits for _ in range(each.count(chain))]
        self._own = len(rates)
        rates += [] if clearance is None else [clearance.clearance.rate] * clearance.max_contacts
        fractions = {rate: (1 - np.exp(-(1 / together if rate is None else rate) * dt)) / dt for rate in rates}
        self._fractions = ca.DM([fractions[rate] for rate in rates])
        self._ways = [1 / (fractions[each.rate] * dt) for each in self.limits]
        """Number of ticks until a distance that decreases at its rate would reach zero."""
        self._begun = float(np.sum(np.minimum(chain.acceleration * dt, START * chain.velocity)))

    def __len__(self) -> int:
        """Number of rows."""
        return self._fractions.numel()

    @property
    def moving_size(self) -> int:
        """Number of values of the moving capsules."""
        return 0 if self.clearance is None else self.clearance.moving_size

    def capsule_numbers(self, argument: str, bodies: Sequence[MovingCapsule] | Array | None) -> Array:
        """Moving capsules (k, 14) from `moving_numbers`; `ConfigurationError` for too many, none, or other objects."""
        if not self.moving:
            raise ConfigurationError(argument, bodies, "None, since no Clearance(moving=...) is among `limits`")
        if bodies is None:
            expected = f"up to {self.moving} MovingCapsule in every tick, [] where none is there: Clearance(moving=...)"
            raise ConfigurationError(argument, bodies, expected)
        return moving_numbers(bodies, self.moving, argument)

    @property
    def contacts_size(self) -> int:
        """Number of values of `contacts`."""
        return 0 if self.clearance is None else self.clearance.size

    def contacts(self, q: ca.MX, last: ca.MX, told: ca.MX, *, ticks: int = 1) -> ca.MX:
        """Nearest contacts, as one column, in the middle of the next `ticks` ticks.

        The arm moves from q (n,) with the velocity `last` (n,); `told` holds the moving capsules.
        """
        return ca.MX(0, 1) if self.clearance is None else self.clearance.nearest(q, last, told, ticks * self.dt)

    def beside(
        self,
        q: ca.SX,
        last: ca.SX,
        contacts: ca.SX,
        *,
        turn: ca.SX,
        base: ca.SX,
        ends: tuple[ca.SX, ca.SX],
        hard: tuple[ca.SX, ca.SX],
        gives_way: ca.SX,
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Rows R u <= r of the limits at q (n,), and a velocity that satisfies them.

        Return R (m, n), r (m,) and the velocity `base` (n,), changed within the intervals `ends`, or if need be within
        `hard`, so that it satisfies the rows. The joint velocities are q' = turn u, with the matrix `turn` (n, n). If
        `gives_way` is 0, `base` moves neither away from approaching bodies nor out of a margin.
        """
        slopes, free, now = self._now(q, last, contacts)
        slopes, least = slopes @ turn, ca.if_else(gives_way, -ca.inf, 0)
        lower, upper = (ca.if_else(gives_way, end, base) for end in ends)
        base = kept_within((slopes, free, ca.fmax(now, least)), base, (lower, upper), hard)
        return -slopes, ca.fmax(free, least), base

    def on_the_way(
        self,
        q: ca.SX,
        last: ca.SX,
        *,
        bodies: ca.SX,
        way: Callable[[ca.SX, ca.SX, float], ca.SX],
        seconds: Sequence[float],
        change: ca.DM,
    ) -> tuple[ca.SX, ca.SX]:
        """R (m, n) and r (m,) of rows R u <= r that keep the limits along the path at the velocities u (n,).

        The rows are linearised at the velocities `last` (n,).

        Parameters
        ----------
        bodies : output of `bodies_on_the_way`.
        way : function of q (n,), u (n,) and t [s] that returns the joint positions (n,) after t at the velocities u.
        seconds : [s] checked times, positive and equally spaced; each makes its own rows.
        change : (n,) largest change of u in a tick; the rows' margin covers the tangents' error for this change.
        """
        here, u = ca.SX.sym("q", self.chain.n), ca.SX.sym("u", self.chain.n)
        rows = [ca.SX(0, 1 + u.numel())]
        for each in self.limits:
            now, *ahead = (each.at(self.chain, way(here, u, t)) for t in (0, *seconds))
            dips = [ca.fmax(a - 2 * b + c, 0) / 8 for a, b, c in zip([now, *ahead], ahead, ahead[1:], strict=False)]
            for t, there, dip in zip(seconds, ahead, [*dips, dips[-1]], strict=True):
                left = _left(t, there - dip, ca.jacobian(there, u), u, change)
                rows.append(smallest_rows(left, each.count(self.chain)))
        found = ca.vertcat(ca.Function("on_the_way", [here, u], [ca.vertcat(*rows)])(q, last), bodies)
        left, slopes = found[:, 0], found[:, 1:]
        return -slopes, ca.fmax(left - slopes @ last, 0)

    def bodies_on_the_way(
        self, *, way: Callable[[ca.SX, ca.SX, float], ca.SX], seconds: Sequence[float], change: ca.DM
    ) -> ca.Function:
        """Function: q (n,), u (n,), moving capsules -> table (max_contacts, 1 + n).

        The table holds the smallest distances to bodies on the path at the velocities u, divided by the time, and their
        slopes. The bodies count as resting.
        """
        assert self.clearance is not None
        n, k = self.chain.n, self.clearance.max_contacts
        here, u, column = ca.SX.sym("q", n), ca.SX.sym("u", n), ca.SX.sym("contacts", self.contacts_size)
        inputs = [ca.MX.sym(name, size) for name, size in (("q", n), ("u", n), ("moving", self.moving_size))]
        distances, slopes, _ = self.clearance.read(column)
        candidates = []
        for t in seconds:
            place = way(here, u, t)
            there = ca.Function("place", [here, u], [place])(*inputs[:2])
            rows = _left(t, distances - SLACK / 2, slopes @ ca.jacobian(place, u), u, change)
            of = ca.Function("candidates", [here, u, column], [ca.densify(rows)], {"cse": True})
            candidates.append(of(*inputs[:2], self.clearance.nearest(there, ca.MX.zeros(n), inputs[2], 0)))
        every = ca.vertcat(*candidates)
        return ca.Function("bodies_on_the_way", inputs, [every[least(every.size1(), k)(every[:, 0]), :]])

    def led_clear(self, velocity: ca.SX, bounds: VelocityBounds, contacts: ca.SX) -> ca.SX:
        """`velocity` (n,), corrected by a Newton step if the arm would come nearer to a body than the margin.

        The argument `contacts` holds the contacts at the end of the tick, from the method `contacts` with `ticks=2`.
        """
        assert self.clearance is not None
        distances, slopes, changes = self.clearance.read(contacts)
        free = ca.fmax((distances - SLACK / 2) / self.dt, -RETURN)
        return _led_across(velocity, slopes, free + changes, bounds.hard)

    @cached_property
    def keeping(self) -> ca.Function:
        """Function of `first_kept` that tests each blend with `judged`."""
        return self.first_kept(self.judged)

    def first_kept(self, judged: ca.Function) -> ca.Function:
        """Function: q, moving capsules, unconstrained velocity, braking velocity -> velocity (n,).

        The result is the first of several blends, see `PARTS`, for which `judged` gives 1; zero if there is none.
        """
        n = self.chain.n
        q, told = ca.MX.sym("q", n), ca.MX.sym("moving", judged.numel_in(1))
        unconstrained, braking = ca.MX.sym("unconstrained", n), ca.MX.sym("braking", n)
        inputs = [q, told, unconstrained, braking]
        tried = [unconstrained, *(braking + part * (unconstrained - braking) for part in PARTS), braking]
        tried += [part * braking for part in PARTS]
        otherwise = ca.Function("rest", inputs, [ca.MX.zeros(n)])
        for i, u in reversed(list(enumerate(tried))):
            this = ca.Function(f"tried_{i}", inputs, [u])
            choice = ca.Function.if_else(f"choice_{i}", this, otherwise)
            otherwise = ca.Function(f"first_kept_{i}", inputs, [choice(judged(q, told, u), *inputs)])
        return otherwise

    @cached_property
    def judged(self) -> ca.Function:
        """Function: q, moving capsules, velocity -> 1 unless a distance ends below zero and also below its value at
        rest; 0 for NaN.
        """
        return self._and_kept(self.clear)

    @cached_property
    def all_clear(self) -> ca.Function:
        """As `judged`, but the verdict is 0 if any body is nearer than its margin, even by the body's own motion."""
        q, told, velocity = self._tick_symbols()
        assert self.clearance is not None
        ends = self.clearance.distances(q + velocity * self.dt, told, self.dt)
        return self._and_kept(ca.Function("all_clear", [q, told, velocity], [self._none_below(ends)]))

    def _and_kept(self, among_bodies: ca.Function) -> ca.Function:
        inputs = self._tick_symbols()
        verdict = among_bodies(*inputs)
        if self.limits:
            here, u = ca.SX.sym("q", self.chain.n), ca.SX.sym("velocity", self.chain.n)
            kept = ca.Function("kept", [here, u], [self.kept(here, u)], {"cse": True})
            verdict = ca.logic_and(verdict, kept(inputs[0], inputs[2]))
        return ca.Function("judged", inputs, [verdict])

    def _tick_symbols(self) -> list[ca.MX]:
        n = self.chain.n
        return [ca.MX.sym("q", n), ca.MX.sym("moving", self.moving_size), ca.MX.sym("velocity", n)]

    @cached_property
    def _none_below(self) -> ca.Function:
        assert self.clearance is not None
        then = ca.SX.sym("then", len(self.clearance.names))
        return ca.Function("clear", [then], [all_true(then >= 0)])

    @cached_property
    def clear(self) -> ca.Function:
        """As `judged`, but only for distances between bodies."""
        (q, told, velocity), verdict = self._tick_symbols(), ca.MX(1)
        if self.clearance is not None:
            then, distances = ca.SX.sym("then", len(self.clearance.names)), self.clearance.distances
            stayed = ca.SX.sym("stayed", then.numel())
            no_worse = ca.Function("no_worse", [then, stayed], [all_true(then >= ca.fmin(stayed, 0) - NEAR)])
            ends = ca.MX.sym("ends", then.numel())
            yes = ca.Function("yes", [ends, q, told], [ca.MX(1)])
            compared = ca.Function("compared", [ends, q, told], [no_worse(ends, distances(q, told, self.dt))])
            there = distances(q + velocity * self.dt, told, self.dt)
            verdict = ca.Function.if_else("clear_or_no_worse", yes, compared)(self._none_below(there), there, q, told)
        return ca.Function("among_bodies", [q, told, velocity], [verdict])

    def kept(self, q: ca.SX, velocity: ca.SX) -> ca.SX:
        """1 if a velocity (n,) moves no distance of a `Limit` below zero, or further below zero; 0 for NaN."""
        conditions = []
        for each in self.limits:
            now, then = each.at(self.chain, q), each.at(self.chain, q + velocity * self.dt)
            conditions.append(then >= ca.fmin(now, 0) - ROUNDING)
        return all_true(*conditions)

    def beyond(self, q: ca.SX) -> ca.SX:
        """1 if a distance of a `Limit` is below zero."""
        return ca.mmin(ca.vertcat(0, *(each.at(self.chain, q) for each in self.limits))) < -OUTSIDE

    def inside(self, contacts: ca.SX) -> ca.SX:
        """1 if two bodies are nearer than their margin."""
        return ca.SX(0) if self.clearance is None else contacts[-1] < -OUTSIDE

    def _now(self, q: ca.SX, last: ca.SX, contacts: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Three results for the least distances: slopes (m, n), and two largest rates of decrease (m,).

        The first rate is that of the barrier; the second reduces a distance to zero in this tick.
        """
        parts = [(ca.SX(0, self.chain.n), ca.SX(0, 1), ca.SX(0, 1))]
        if self.limits:
            slopes, least, spent = self._tangents(q, last, self._ways)
            free = self._fractions[: self._own] * least - spent
            parts.append((slopes, free, ca.fmax(least, 0) / self.dt))
        if self.clearance is not None:
            distances, slopes, changes = self.clearance.read(contacts)
            parts.append(self._between_bodies(last, distances, slopes, changes))
        slopes, free, hard = (ca.vertcat(*column) for column in zip(*parts, strict=True))
        return slopes, free, hard

    def _between_bodies(
        self, last: ca.SX, distances: ca.SX, slopes: ca.SX, changes: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """As `_now`, for contacts; the slopes are those at mid-tick after the last velocity."""
        way = self.dt * (ca.sum1(ca.fabs(last)) + self._begun)
        margin = ca.sqrt(ca.sum2(slopes**2)) * way**2 / 2 + SLACK
        # So that no joint oscillates near the posture of the largest distance, where slopes change sign.
        steep = ca.fabs(slopes) * ca.fmin(ca.fabs(slopes) / FLAT, 1)
        free = ca.fmax(self._fractions[self._own :] * (distances - SLACK / 2 - margin), -steep @ self._calm)
        return slopes, free + changes, ca.fmax(distances - SLACK / 2, 0) / self.dt + changes

    def _tangents(self, q: ca.SX, last: ca.SX, ways: Sequence[float]) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Of the least distances: slopes (m, n), values (m,), and error rates (m,) of their tangents in this tick."""
        seconds = self.dt
        found = [one.nearest(self.chain, q, seconds * last, k) for one, k in zip(self.limits, ways, strict=True)]
        least, slopes, lost = (ca.vertcat(*column) for column in zip(*found, strict=True))
        way, begun = seconds * ca.sum1(ca.fabs(last)), seconds * self._begun
        margin = ca.sqrt(ca.sum2(slopes**2)) * (way + begun / 2) * begun
        lacking = clipped(margin - least, 0, margin)
        return slopes, least, self._fractions[: self._own] * (margin - lacking) + (lacking + lost) / seconds


def _left(t: float, distances: ca.SX, changes: ca.SX, u: ca.SX, change: ca.DM) -> ca.SX:
    """Table (m, 1 + n): distances after t [s], minus a margin for changes of u (n,), and slopes; all divided by t."""
    largest, slopes = ca.mmax(change), changes / t
    begun = ca.fmin(largest, ca.mmax(ca.fabs(u))) * largest / 2
    return ca.horzcat(distances / t - begun * t * ca.sqrt(ca.sum2(slopes**2)), slopes)


def kept_within(
    now: tuple[ca.SX, ca.SX, ca.SX], rest: ca.SX, ends: tuple[ca.SX, ca.SX], outer: tuple[ca.SX, ca.SX]
) -> ca.SX:
    """Velocity `rest` (n,), changed so that it satisfies the limits `now`, one limit after the other.

    For each violated limit, the velocity moves, as far as needed, towards those ends of the intervals `ends` that help
    to satisfy the limit. Motion that still violates a limit is removed along the limit's slope, within the intervals
    `outer`. If that is not enough, all joints slow down by the same factor.
    """
    (lower, upper), (slopes, free, hard) = ends, now
    u = rest
    for i in list(range(slopes.size1())) * PASSES:
        slope = slopes[i, :].T
        matters = ca.fabs(slope) > MATTERS * ca.mmax(ca.fabs(slope))
        end = ca.if_else(matters, ca.if_else(slope > 0, upper, lower), u)
        over, most = -ca.dot(slope, u) - free[i], ca.dot(slope, end - u)
        u += ca.if_else(over > 0, ca.fmin(over / ca.fmax(most, TINY), 1), 0) * (end - u)
    u = _led_across(u, slopes, hard, outer)
    closing, least = -slopes @ u, ca.fmax(hard, 0)  # slowing down only helps against the arm's own motion
    return ca.fmin(1, ca.mmin(ca.if_else(closing > least, least / ca.fmax(closing, TINY), 1))) * u


def _led_across(velocity: ca.SX, slopes: ca.SX, hard: ca.SX, outer: tuple[ca.SX, ca.SX]) -> ca.SX:
    """`velocity` (n,), corrected along the slope of each limit that it violates, within the intervals `outer`."""
    u = velocity
    for i in list(range(slopes.size1())) * PASSES:
        slope = slopes[i, :].T
        over = ca.fmax(-ca.dot(slope, u) - hard[i], 0)
        u = ca.if_else(over > 0, clipped(u + slope * (over / ca.fmax(ca.sumsqr(slope), TINY)), *outer), u)
    return u
