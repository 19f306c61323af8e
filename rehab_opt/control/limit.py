"""Limits of a posture, a user's own and clearance: stated once, kept by QP, shortened step and safe command."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from rehab_opt.control.clearance import Clearance, checked_clearance
from rehab_opt.control.clearance_pairs import ClearancePairs
from rehab_opt.control.stopping import OUTSIDE, VelocityBounds, nearest_to_rest
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["Limit", "Limits", "all_limits", "checked_limits"]

ROUNDING = 1e-13
"""[rad, m] of a joint, by which rounding may take a distance further below zero."""
PARTS = (0.75, 0.5, 0.25)
"""Of the way from braking to the QP's answer, and of braking itself, that are tried where those lead beyond a limit."""
NEAR = 1e-13
"""[m] by which rounding may bring bodies nearer."""
PASSES = 2
"""Over all limits, in which a velocity is looked for that keeps them."""
START = 0.1
"""Share of the largest speeds that a joint may reach in a tick and still be met by the margin, however fast it gets."""
FLAT = 0.05
"""[m/rad] Slope of a distance between bodies below which the way back from within the margin becomes slower."""
SLACK = 1e-5
"""[m] More than the margin at which bodies touch: what distances of bodies that lie along each other bend by."""
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
        are small; of several the least one makes the row of the QP, all of them are judged at the end of the tick.
        Where they, or their slopes, are no numbers, nothing is certified.
    rate : [1/s] at which the least distance may decay; by default 1/T, T the longest of the joints' speeds over their
        accelerations, so that all joints can brake together before it.
    """

    distances: Callable[[SerialChain, ca.SX], ca.SX]
    rate: float | None = None

    def at(self, chain: SerialChain, q: ca.SX) -> ca.SX:
        """(k,) the distances at q (n,)."""
        return ca.densify(ca.vec(ca.SX(self.distances(chain, q))))

    def nearest(self, chain: SerialChain, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The least distance at q (n,), and how it changes with q (1, n)."""
        symbol = ca.SX.sym("q", chain.n)
        each = self.at(chain, symbol)
        slopes = ca.jacobian(each, symbol)
        least, slope = each[0], slopes[0, :]
        for i in range(1, each.numel()):
            closer = each[i] < least
            least, slope = ca.if_else(closer, each[i], least), ca.if_else(closer, slopes[i, :], slope)
        return ca.Function("nearest", [symbol], [least, ca.densify(slope)]).call([q])  # type: ignore[return-value]


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


def all_limits(limits: Sequence[Limit | Clearance], chain: SerialChain, dt: float, recovery_speed: float) -> Limits:
    """The limits of an arm, one `Clearance` among them or none.

    Raises
    ------
    ConfigurationError : as for `checked_limits` and `checked_clearance`; more than one clearance.
    """
    if not isinstance(limits, (list, tuple)) or not all(isinstance(each, (Limit, Clearance)) for each in limits):
        raise ConfigurationError("limits", limits, "a list or tuple of Limit, and a Clearance")
    found = [(f"limits[{i}]", each) for i, each in enumerate(limits) if isinstance(each, Clearance)]
    if len(found) > 1:
        raise ConfigurationError(found[1][0], found[1][1], "one Clearance, which holds all bodies")
    pairs = [ClearancePairs(checked_clearance(name, each, chain), chain) for name, each in found]
    others = checked_limits([each for each in limits if isinstance(each, Limit)], chain)
    found_pairs = next((each for each in pairs if each.names), None)
    return Limits(others, chain, dt, found_pairs, recovery_speed=recovery_speed)


class Limits:
    """The limits of one arm in one tick.

    A margin is kept before each, the square of the joints' way in a tick: nearer than that the row leads the arm away
    again, so that it slides along a curved limit and does not stick. Limits come before accelerations, also while
    braking, and after speeds and joint limits.

    Parameters
    ----------
    limits : what `checked_limits` gives. chain : the arm. dt : tick [s].
    clearance : its pairs, where there is a `Clearance`: each of its contacts makes a row, behind those of the limits.
    recovery_speed : share of the joints' speeds at which the arm is led back to where a limit is kept.
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
        self._calm = ca.DM(recovery_speed * chain.velocity)
        together = max(float(np.max(chain.velocity / chain.acceleration)), dt)
        rates = [each.rate for each in self.limits]
        rates += [] if clearance is None else [clearance.clearance.rate] * clearance.slots
        self._shares = ca.DM([(1 - np.exp(-(1 / together if rate is None else rate) * dt)) / dt for rate in rates])
        self._begun = float(np.sum(np.minimum(chain.acceleration * dt, START * chain.velocity)))

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.limits) + (0 if self.clearance is None else self.clearance.slots)

    @property
    def moving(self) -> int:
        """How many moving capsules a tick is told of."""
        return 0 if self.clearance is None else self.clearance.clearance.moving

    @property
    def told(self) -> int:
        """Numbers of those."""
        return 0 if self.clearance is None else self.clearance.told

    @property
    def contacts_size(self) -> int:
        """Numbers of the column of `contacts`."""
        return 0 if self.clearance is None else self.clearance.size

    def contacts(self, q: ca.MX, last: ca.MX, told: ca.MX) -> ca.MX:
        """Nearest contacts as one column, of positions and last velocity (n,), and moving capsules."""
        return ca.MX(0, 1) if self.clearance is None else self.clearance.nearest(q, last, told, self.dt)

    def rows(
        self, q: ca.SX, last: ca.SX, bounds: VelocityBounds, contacts: ca.SX
    ) -> tuple[ca.SX, ca.SX, VelocityBounds]:
        """R (m, n), r (m,) of R q' <= r, and the intervals, opened where acceleration has to yield.

        There is always a velocity that keeps them all: looked for between the intervals' ends, and where none of those
        keeps a distance above zero, beyond them.
        """
        rest = nearest_to_rest(bounds._replace(brake_lower=bounds.lower, brake_upper=bounds.upper))
        slopes, free, _ = now = self._now(q, last, contacts)
        kept = _kept_within(now, rest, (bounds.lower, bounds.upper), bounds)
        opened = bounds._replace(
            lower=ca.fmin(bounds.lower, kept),
            upper=ca.fmax(bounds.upper, kept),
            outside=ca.logic_or(bounds.outside, self.inside(contacts)),
        )
        return -slopes, ca.fmax(free, -slopes @ kept), opened

    def slower(self, q: ca.SX, last: ca.SX, bounds: VelocityBounds, contacts: ca.SX) -> ca.SX:
        """(n,) the velocity nearest to rest, but for joints that hold theirs longer where a limit wants it.

        From what comes nearer by itself it does not go away: who brakes is not enabled.
        """
        rest = nearest_to_rest(bounds)
        held = clipped(last, bounds.brake_lower, bounds.brake_upper)
        slopes, free, hard = self._now(q, last, contacts)
        now = (slopes, free, ca.fmax(hard, 0))
        return _kept_within(now, rest, (ca.fmin(rest, held), ca.fmax(rest, held)), bounds)

    @cached_property
    def keeping(self) -> ca.Function:
        """Q, moving capsules, wanted, braking -> the first velocity (n,) that leads beyond no limit.

        Of `wanted`, parts of the way there from `braking`, and parts of that; each is judged where those before failed.
        """
        n = self.chain.n
        q, told = ca.MX.sym("q", n), ca.MX.sym("moving", self.told)
        wanted, braking = ca.MX.sym("wanted", n), ca.MX.sym("braking", n)
        inputs = [q, told, wanted, braking]
        tried = [wanted, *(braking + part * (wanted - braking) for part in PARTS), braking]
        tried += [part * braking for part in PARTS]
        otherwise = ca.Function("rest", inputs, [ca.MX.zeros(n)])
        for i, u in reversed(list(enumerate(tried))):
            this = ca.Function(f"tried_{i}", inputs, [u])
            choice = ca.Function.if_else(f"choice_{i}", this, otherwise)
            otherwise = ca.Function(f"first_kept_{i}", inputs, [choice(self.judged(q, told, u), *inputs)])
        return otherwise

    @cached_property
    def judged(self) -> ca.Function:
        """Q, moving capsules, velocity -> 1 where that leads no distance below zero, nor below what rest would.

        NaN fails.
        """
        n = self.chain.n
        q, told, velocity = ca.MX.sym("q", n), ca.MX.sym("moving", self.told), ca.MX.sym("velocity", n)
        inputs, verdict = [q, told, velocity], ca.MX(1)
        if self.clearance is not None:
            then, distances = ca.SX.sym("then", len(self.clearance.names)), self.clearance.distances
            stayed = ca.SX.sym("stayed", then.numel())
            clear = ca.Function("clear", [then], [all_true(then >= 0)])
            no_worse = ca.Function("no_worse", [then, stayed], [all_true(then >= ca.fmin(stayed, 0) - NEAR)])
            ends = ca.MX.sym("ends", then.numel())
            yes = ca.Function("yes", [ends, q, told], [ca.MX(1)])
            compared = ca.Function("compared", [ends, q, told], [no_worse(ends, distances(q, told, self.dt))])
            there = distances(q + velocity * self.dt, told, self.dt)
            verdict = ca.Function.if_else("clear_or_no_worse", yes, compared)(clear(there), there, q, told)
        if self.limits:
            here, u = ca.SX.sym("q", n), ca.SX.sym("velocity", n)
            kept = ca.Function("kept", [here, u], [self.kept(here, u)], {"cse": True})
            verdict = ca.logic_and(verdict, kept(q, velocity))
        return ca.Function("judged", inputs, [verdict])

    def kept(self, q: ca.SX, velocity: ca.SX) -> ca.SX:
        """1 where a velocity leads no `Limit` below zero, nor further below; NaN fails."""
        conditions = []
        for each in self.limits:
            now, then = each.at(self.chain, q), each.at(self.chain, q + velocity * self.dt)
            conditions.append(then >= ca.fmin(now, 0) - ROUNDING * ca.norm_2(each.nearest(self.chain, q)[1]))
        return all_true(*conditions)

    def inside(self, contacts: ca.SX) -> ca.SX:
        """1 where a contact is nearer than its margin."""
        if self.clearance is None:
            return ca.SX(0)
        return ca.mmin(self.clearance.read(contacts)[0]) < -OUTSIDE

    def _now(self, q: ca.SX, last: ca.SX, contacts: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Slopes (m, n) of the least distances, how fast they may fall, and may not but in this tick (m,).

        The slopes are those of the middle of the tick, where the last velocity leads. What the way bends by besides is
        kept as a margin: the square of the joints' way in a tick.
        """
        least = ca.vertcat(ca.SX(0, 1), *(each.nearest(self.chain, q)[0] for each in self.limits))
        slopes = ca.vertcat(
            ca.SX(0, self.chain.n), *(each.nearest(self.chain, q + last * (self.dt / 2))[1] for each in self.limits)
        )
        changes = ca.SX(len(self.limits), 1)
        if self.clearance is not None:
            distances, along, besides = self.clearance.read(contacts)
            least, slopes, changes = (
                ca.vertcat(least, distances),
                ca.vertcat(slopes, along),
                ca.vertcat(changes, besides),
            )
        way = self.dt * (ca.sum1(ca.fabs(last)) + self._begun)
        margin = ca.sqrt(ca.sum2(slopes**2)) * way**2 / 2
        share, back = self._shares * (least - margin), -ca.SX.inf(len(self.limits))
        if self.clearance is not None:
            # Where a distance is nearly as large as a posture can make it, no joint goes to and fro about that posture.
            steep = ca.fabs(along) * ca.fmin(ca.fabs(along) / FLAT, 1)
            back = ca.vertcat(back, -steep @ self._calm)
            share -= SLACK * self._shares * ca.vertcat(ca.SX.zeros(len(self.limits)), ca.SX.ones(distances.numel()))
            least[len(self.limits) :] -= SLACK / 2
        return slopes, ca.fmax(share, back) + changes, ca.fmax(least, 0) / self.dt + changes


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
    closing, least = -slopes @ u, ca.fmax(hard, 0)  # to slow down helps against what the arm does itself
    return ca.fmin(1, ca.mmin(ca.if_else(closing > least, least / ca.fmax(closing, TINY), 1))) * u
