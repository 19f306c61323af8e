"""Joint velocities for a twist before speed bounds: damped at singular poses, joints at their limits held."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.damped import DAMPING, PASSES, damped_velocity
from rehab_opt.control.stopping import FAR, VelocityBounds
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.fused import ANALYTIC_TOLERANCE, by_dual_active_set, choice, exact_round
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import MAX_MAGNITUDE, parameter, variable, within
from rehab_opt.symbolic.shared import remembered
from rehab_opt.symbolic.tick import Stages

__all__ = ["ReferenceVelocity"]

CLAIM_TOLERANCE = 1e-6
"""[rad/s] How far a claimed bounded answer may move on."""
ROW_PASSES = 2
"""Of the closed form with one row active: it is used away from singular poses, where the damping hardly errs."""
INSIDE = 1e-9
"""[rad/s] By how much the reference stays inside its rows."""
MISSED = 1e-2
"""Fraction of the twist from which on the reference leaves some of it: damped more then."""
CALMING = 0.1
"""[m s] What is left beside rows is an error that stays, and the way to its least bends: by a hand's curve (`damped`),
about its reach, and by its limits', which is not known here. Where that is not counted, joints near a stretched elbow
or at a curved limit swing past the least and back for good. Damping by a metre for what is left of a metre's error, at
the rate of feedback (20 /s in ticks of 20 ms), counts it; `PASSES` undo two thirds."""
MOMENTUM = 0.8
"""Fraction of the last velocity that `CALMING` is about, as of Polyak's heavy ball (1964). About rest, what hardly
changes the error, as a turn of a wrist that counts little, would creep for tens of seconds; so it goes on
1 / (1 - `MOMENTUM`) times as fast, in ticks of any length. Nor does it swing more: with a fraction s of the last
velocity kept, a tick's motion may be up to 2 (1 + s) times the way to the least until it does, not 2 times."""

Excess = Callable[[ca.SX], ca.SX]


class ReferenceVelocity(NamedTuple):
    """Joint velocities of a controller's task before they are slowed to its bounds, as expressions.

    Where a joint would move faster than it can still stop at its position limit, they are those of

    min |J q' - v|^2 + damping |q' - drift|^2    s.t.  q' within the speeds from which the joints can still stop,
                                                       R q' <= r,

    iterated as `damped_velocity` is; that solve is left out where no joint is near its limit and no row is reached.
    Where there are rows and some of v is left undone, the damping grows with it (`CALMING`), as in Sugihara's
    Levenberg-Marquardt. Without it, keeping the direction of an undeliverable motion would stop the arm where going on
    to the nearest pose is wanted.
    """

    jacobian: ca.SX
    """(k, n) J"""
    twist: ca.SX
    """(k,) v"""
    drift: ca.SX
    """(n,) joint velocity where the twist leaves it free."""
    bounds: VelocityBounds
    speed: NDArray[np.float64]
    """(n,) velocity limits."""
    locked: NDArray[np.bool_]
    """(n,) joints that cannot move at all."""
    rows: ca.SX
    """(m, n) R"""
    upper: ca.SX
    """(m,) r"""

    def stated(self, tick: Stages, q: ca.SX, last: ca.SX, *, excess: Excess) -> tuple[ca.SX, ca.SX]:
        """(n,) velocities at q (n,) after `last` (n,), and the twist (k,) that they deliver.

        Where `excess` of these velocities is above 1, they are slowed by it.
        """
        n = q.numel()
        free = damped_velocity(self._moving, self.twist, drift=self.drift)
        # A limit that is felt only above the velocity limit is not why a joint is held: the whole motion slows down.
        low = ca.if_else(self.bounds.stop_lower <= -self.speed, -FAR, self.bounds.stop_lower)
        high = ca.if_else(self.bounds.stop_upper >= self.speed, FAR, self.bounds.stop_upper)
        free, low, high = tick.once((free, low, high))
        leaves = ca.sum1(ca.vertcat(free > high, free < low, self.rows @ free > self.upper)) > 0
        finite = ca.sumsqr(ca.vertcat(q, free)) <= MAX_MAGNITUDE**2  # no solver sees what cannot be used
        motion = self.within_rows(tick, free, low, high, last, needed=ca.logic_and(leaves, finite))
        motion = tick.once(motion / ca.fmax(excess(motion[:n]), 1))
        return motion[:n], motion[n:]

    def within_rows(self, tick: Stages, free: ca.SX, low: ca.SX, high: ca.SX, last: ca.SX, *, needed: ca.SX) -> ca.SX:
        """(n + k,) velocities within stopping speeds (n,) and rows, and their twist; not `needed` where `free` are.

        What is left of the twist damps them, whether rows leave it or a singular pose does: they take no step where a
        row is reached.
        """
        low, high = (ca.DM(~self.locked) * each for each in (low, high))
        (k, n), m = self.jacobian.shape, self.rows.size1()
        solver = remembered(("bounded", n, k, m), lambda: _solver(n, k, m))
        task = ca.vertcat(ca.vec(ca.densify(self.jacobian)), self.twist)
        rows = ca.vertcat(ca.vec(ca.densify(self.rows)), self.upper)

        def solved(about: ca.SX, damping: ca.SX | float, nearly: ca.SX) -> ca.SX:
            """Certified by the multipliers: rows leave no other way to tell a solution."""
            reached = ca.vertcat((nearly >= high) - (nearly <= low), self.rows @ nearly > self.upper - 2 * INSIDE)
            (found,) = tick.call(solver, task, about, low, high, rows, ca.SX(damping), reached)
            return self._delivered(ca.if_else(found[-1] <= CLAIM_TOLERANCE, found[:n], clipped(nearly, low, high)))

        def held() -> ca.SX:
            closed, right = self._by_the_first_row(low, high)
            return tick.when(right, closed, lambda: solved(self.drift, DAMPING, free))

        motion = tick.when(needed, held, self._delivered(free))
        left = ca.norm_2(self.twist - motion[n:]) - MISSED * ca.norm_2(self.twist)
        damping = DAMPING + CALMING * left
        about = self.drift + MOMENTUM * CALMING * left / damping * (last - self.drift)  # of nothing left as it was
        some = ca.logic_and(left > 0, left <= MAX_MAGNITUDE)
        return tick.when(some, lambda: solved(about, damping, motion[:n]), motion)

    def _by_the_first_row(self, low: ca.SX, high: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(n + k,) in closed form where the first row alone is active, the usual case; and 1 where it is right."""
        x, normal = self.drift, self.rows[0, :].T
        hessian, _ = self._model(x)
        diagonal, factor, order = ca.ldl(ca.densify(hessian), False)
        towards = ca.ldl_solve(ca.densify(normal), diagonal, factor, order)
        stiffness = ca.fmax(ca.dot(normal, towards), 1e-12)
        multiplier = ca.SX(0)
        for _ in range(ROW_PASSES):
            free = -ca.ldl_solve(ca.densify(self._model(x)[1]), diagonal, factor, order)
            multiplier = (ca.dot(normal, free) - self.upper[0] + INSIDE) / stiffness
            x = free - multiplier * towards
        fits = ca.vertcat(x >= low, x <= high, self.rows @ x <= self.upper)
        return self._delivered(x), ca.logic_and(multiplier >= 0, ca.sum1(fits) == fits.numel())  # NaN fails

    def _model(self, about: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Hessian (n, n) and gradient (n,) of half the cost, damped about a velocity (n,)."""
        hessian = self._moving.T @ self._moving + DAMPING * ca.SX.eye(about.numel())
        return hessian, -(self._moving.T @ self.twist) - DAMPING * about

    def _delivered(self, velocity: ca.SX) -> ca.SX:
        """(n + k,) velocities and their twist."""
        return ca.vertcat(velocity, self._moving @ velocity)

    @property
    def _movable(self) -> ca.DM:
        """(n, n) 1 on the diagonal for joints that can move."""
        return ca.diag(ca.sparsify(ca.DM(~self.locked)))

    @property
    def _moving(self) -> ca.SX:
        """(k, n) the Jacobian of joints that can move."""
        return ca.sparsify(self.jacobian @ self._movable)


def _solver(n: int, k: int, m: int) -> ca.Function:
    """Task, what the damping is about, low, high, rows, damping, reached -> x, multipliers, and their residual.

    Of the last of the passes, each damped about what the one before found. `reached` (n + m,) has the signs of the
    multipliers that are expected; a pass that they do not fit, or those of the pass before, asks the dual method.
    """
    task, about, low, high = (
        parameter("task", k * n + k),
        parameter("about", n),
        parameter("low", n),
        parameter("high", n),
    )
    rows, damping = parameter("rows", m * n + m), parameter("damping", 1)
    velocity = variable("velocity", n, lower=low, upper=high)
    error = ca.reshape(task[: k * n], k, n) @ velocity.symbol - task[k * n :]
    cost = ca.sumsqr(error) + damping * ca.sumsqr(velocity.symbol - about)
    # Just inside the rows, so that rounding does not make the analytic answer look as if it were outside.
    over = within(ca.reshape(rows[: m * n], m, n) @ velocity.symbol, -ca.inf, rows[m * n :] - INSIDE)
    stated = Statement("bounded", [task, about, low, high, rows, damping], [velocity], cost / 2, [over])
    form, numbers = stated.form()
    exact = exact_round(form)
    otherwise = choice("if_certified", by_dual_active_set(form, exact))

    inputs = [ca.MX.sym("p", each.numel()) for each in stated.parameters]
    centre, active = inputs[1], ca.MX.sym("reached", n + m)
    inputs.append(active)
    for _ in range(PASSES):
        qp = numbers(ca.vertcat(inputs[0], centre, *inputs[2:-1]), ca.MX(0, 1))
        found = exact(qp, active)
        found = otherwise(found[-1] <= ANALYTIC_TOLERANCE, found, qp)
        centre, active = found[:n], found[n:-1]
    return ca.Function("bounded", inputs, [found])
