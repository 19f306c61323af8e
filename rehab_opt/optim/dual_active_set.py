"""A QP by the dual active set method of Goldfarb and Idnani: it cannot cycle, whatever bounds meet in a corner.

It begins at the answer of the equalities alone and takes in one broken bound after the other, dropping those that stop
pushing on the way; the cost only rises, so no set of active bounds comes twice. Active bounds are independent at each
step, so that there are no more of them than variables. A step is a function without branches; the steps follow one
another in compiled code until none is broken.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.active_set import BROKEN, picked
from rehab_opt.optim.equalities import equality_rows
from rehab_opt.optim.factor import solver_of

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Statement

__all__ = ["dual_active_set"]

STEPS = 24
"""Bounds taken in or dropped; random states among walls and keep-outs needed 5 in the median and 18 at most."""
DEPENDENT = 1e-10
"""Share of a bound's curvature that must be left beside the active ones, or it depends on them."""


def dual_active_set(statement: Statement) -> ca.Function:
    """Complete parameters, memory -> multipliers of bounds and rows (n + m,), positive at an upper bound.

    The statement's cost must be strictly convex, and its equalities independent; otherwise they are not finite.
    """
    n, m = statement.n, statement.m
    full, memory = ca.MX.sym("full", statement.build.sparsity_in(0)), ca.MX.sym("memory", statement.memory.numel())
    state = _first(statement)(full, memory)
    step = _step(statement)
    old = ca.MX.sym("old", state.numel())
    keep = ca.Function("keep", [old, full, memory], [old])
    go_on = ca.Function("go_on", [old, full, memory], [step(full, memory, old)])
    either = ca.Function.if_else(f"{statement.name}_unless_done", keep, go_on)
    for _ in range(STEPS):
        state = either(state[-1], state, full, memory)
    multipliers, active, pending, _ = ca.vertsplit(state, [0, n + m, 2 * (n + m), 3 * (n + m), state.numel()])
    # Of a bound that is met and does not push, rounding may give the sign of the opposite one: that would be another.
    told = ca.if_else(multipliers * (active + pending) < 0, 0, multipliers)
    return ca.Function(f"{statement.name}_dual", [full, memory], [told])


class _Numbers:
    """The QP with its bounds as the first rows, all in expressions of complete parameters and memory."""

    def __init__(self, statement: Statement) -> None:
        n, m = statement.n, statement.m
        self.full = ca.SX.sym("full", statement.build.sparsity_in(0))
        self.memory = ca.SX.sym("memory", statement.memory.numel())
        hessian, self.gradient, matrix, low, high, lower, upper, _ = statement.build.call([self.full, self.memory])
        self.rows = ca.vertcat(ca.SX.eye(n), ca.sparsify(matrix))
        self.low, self.high = ca.vertcat(lower, low), ca.vertcat(upper, high)
        self.equal = [n + i for i in equality_rows(low, high)]
        self.other = [i for i in range(n + m) if i not in self.equal]
        self.most = max(n - len(self.equal), 0)
        self.solve = solver_of(hessian)


def _first(statement: Statement) -> ca.Function:
    """Multipliers of the equalities alone; no bound active, none pending, not done."""
    of, size = _Numbers(statement), statement.n + statement.m
    state = ca.SX.zeros(3 * size + 1)
    if of.equal:
        rows = of.rows[of.equal, :]
        sideways = of.solve(rows.T)
        state[of.equal] = -solver_of(rows @ sideways)(sideways.T @ of.gradient + of.high[of.equal])
    return ca.Function(f"{statement.name}_dual_first", [of.full, of.memory], [ca.densify(state)], {"cse": True})


def _step(statement: Statement) -> ca.Function:
    """Complete parameters, memory, state -> the next state.

    A state stacks, for bounds and rows (n + m,) each: multipliers; 1 and -1 where the upper or lower one is active; the
    same for the one that is being taken in; then whether no bound is broken.
    """
    of, size = _Numbers(statement), statement.n + statement.m
    state = ca.SX.sym("state", 3 * size + 1)
    multipliers, active, pending = (state[k * size : (k + 1) * size] for k in range(3))
    x = -of.solve(of.gradient + of.rows.T @ multipliers)
    values = of.rows @ x

    # What to take in: what is pending, or what is broken most.
    above, below = values - of.high, of.low - values
    begun = ca.sumsqr(pending) > 0
    broken = ca.SX.zeros(size)
    for i in of.other:
        broken[i] = ca.if_else(active[i] == 0, ca.fmax(above[i], below[i]), -1)
    worst = ca.mmax(broken)
    done = ca.logic_and(ca.logic_not(begun), worst <= BROKEN)
    new, found = ca.SX.zeros(size), ca.SX(0)
    for i in of.other:
        hit = ca.logic_and(broken[i] >= worst, ca.logic_not(found))
        new[i], found = hit * ca.if_else(above[i] > below[i], 1, -1), ca.logic_or(found, hit)
    pending = ca.if_else(begun, pending, new)

    # Where x goes as its multiplier grows while the active ones stay as they are.
    taken = picked(active[of.other] != 0, of.most)
    rows = ca.vertcat(of.rows[of.equal, :], taken @ of.rows[of.other, :])
    used = ca.vertcat(ca.SX.ones(len(of.equal)), ca.sum2(taken))
    normal = of.rows.T @ pending
    limit = ca.sum1(ca.if_else(pending > 0, of.high, ca.if_else(pending < 0, -of.low, 0)))
    sideways, straight = of.solve(rows.T), of.solve(normal)
    stiffness = ca.triu2symm(ca.triu(rows @ sideways)) + ca.diag(1 - used)
    change = -solver_of(stiffness)(rows @ straight)
    curvature, rest = ca.dot(normal, straight), ca.dot(normal, straight + sideways @ change)

    # As far as it holds, or as one of the active ones stops pushing.
    enough = ca.if_else(rest > DEPENDENT * curvature, (ca.dot(normal, x) - limit) / rest, ca.inf)
    pushing, change_of = taken @ multipliers[of.other], change[len(of.equal) :]
    sides = taken @ active[of.other]
    stops = ca.if_else(sides * change_of < 0, -pushing / change_of, ca.inf)
    soonest = ca.mmin(stops)
    way = ca.fmin(enough, soonest)
    held = enough <= soonest
    dropped, gone = ca.SX.zeros(of.most), ca.SX(0)
    for j in range(of.most):
        hit = ca.logic_and(ca.logic_not(held), ca.logic_and(stops[j] <= soonest, ca.logic_not(gone)))
        dropped[j], gone = hit, ca.logic_or(gone, hit)
    leaving = ca.SX.zeros(size)
    leaving[of.other] = taken.T @ dropped
    multipliers = multipliers + way * pending
    multipliers[of.equal] += way * change[: len(of.equal)]
    multipliers[of.other] += taken.T @ (way * change_of)
    following = ca.vertcat(
        ca.if_else(leaving, 0, multipliers), ca.if_else(leaving, 0, active) + held * pending, (1 - held) * pending, 0
    )
    stay = ca.vertcat(state[:-1], 1)
    outputs = [ca.densify(ca.if_else(done, stay, following))]
    return ca.Function(f"{statement.name}_dual_step", [of.full, of.memory, state], outputs, {"cse": True})
