"""A user's own limit on an arm's posture: stated once, kept by the QP, the shortened step and the safe command."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from rehab_opt.control.stopping import VelocityBounds, nearest_to_rest
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true

__all__ = ["Limit", "Limits", "checked_limits"]

ROUNDING = 1e-12
"""By how much rounding may take a distance further below zero."""
PARTS = (0.75, 0.5, 0.25)
"""Of the way from braking to the QP's answer, and of braking itself, that are tried where those lead beyond a limit."""
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Limit:
    """What a posture has to keep: every distance h(q) at zero or above, at the end of every tick.

    h(q) >= 0, met as the barrier  grad h . q' >= -rate h

    Parameters
    ----------
    distances : chain, joint positions (n,) -> (k,) distances h(q) as CasADi expressions, in any unit. Smooth where they
        are small; of several the least one makes the row of the QP, all of them are judged at the end of the tick.
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
        except (TypeError, NotImplementedError) as problem:
            raise ConfigurationError(f"limits[{i}].distances", each.distances, "an expression of q") from problem
        if not column.numel() or not ca.depends_on(column, q) or {str(s) for s in ca.symvar(column)} - {
            str(s) for s in ca.symvar(q)
        }:  # fmt: skip
            raise ConfigurationError(f"limits[{i}].distances", column, "an expression of q, and of nothing else")
    return tuple(limits)


class Limits:
    """The limits of one arm in one tick.

    While braking, and where nothing else is left, they come before accelerations and after speeds and joint limits.

    Parameters
    ----------
    limits : what `checked_limits` gives. chain : the arm. dt : tick [s].
    """

    def __init__(self, limits: Sequence[Limit], chain: SerialChain, dt: float) -> None:
        self.limits, self.chain, self.dt = tuple(limits), chain, dt
        together = max(float(np.max(chain.velocity / chain.acceleration)), dt)
        rates = [1 / together if each.rate is None else each.rate for each in self.limits]
        self._shares = [(1 - np.exp(-rate * dt)) / dt for rate in rates]

    def __len__(self) -> int:
        return len(self.limits)

    def rows(self, q: ca.SX, last: ca.SX, losses: ca.SX, bounds: VelocityBounds) -> tuple[ca.SX, ca.SX, VelocityBounds]:
        """R (m, n), r (m,) of R q' <= r, and the intervals, opened where acceleration has to yield.

        The velocity nearest to rest keeps every row, or a part of it does. A row is that of the middle of the tick,
        where the last velocity leads: there a link that slides along a limit comes no nearer. `losses` (m,) are by how
        much the last tick came nearer than that.
        """
        rest = nearest_to_rest(bounds._replace(brake_lower=bounds.lower, brake_upper=bounds.upper))
        least, slopes = self._now(q, last)
        closing, hard = -slopes @ rest, ca.fmax(least, 0) / self.dt
        free = ca.DM(self._shares) * ca.fmax(least - 2 * losses, 0)
        kept = self.braking(q, last, rest)
        opened = bounds._replace(lower=ca.fmin(bounds.lower, kept), upper=ca.fmax(bounds.upper, kept))
        return -slopes, ca.fmax(free, ca.fmin(closing, hard)), opened

    def braking(self, q: ca.SX, last: ca.SX, rest: ca.SX) -> ca.SX:
        """(n,) the part of `rest`, the velocity nearest to rest, that leads beyond no limit in this tick."""
        least, slopes = self._now(q, last)
        closing, hard = -slopes @ rest, ca.fmax(least, 0) / self.dt
        return ca.fmin(1, ca.mmin(ca.if_else(closing > hard, hard / ca.fmax(closing, TINY), 1))) * rest

    def _now(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(m,) least distances at q, and their slopes (m, n) in the middle of the tick."""
        least = [each.nearest(self.chain, q)[0] for each in self.limits]
        slopes = [each.nearest(self.chain, q + last * (self.dt / 2))[1] for each in self.limits]
        return ca.vertcat(*least), ca.vertcat(*slopes)

    def lost(self, q: ca.SX, last: ca.SX, velocity: ca.SX) -> ca.SX:
        """(m,) by how much nearer a velocity leads than the rows of the tick say."""
        least, slopes = self._now(q, last)
        then = ca.vertcat(*(each.nearest(self.chain, q + velocity * self.dt)[0] for each in self.limits))
        return ca.fmax(least + slopes @ velocity * self.dt - then, 0)

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
            conditions.append(then >= ca.fmin(now, 0) - ROUNDING)
        return all_true(*conditions)
