"""Solve a QP for a given active set, or by the dual active set method of Goldfarb and Idnani.

The dual method starts at the solution of the equalities alone and adds one violated bound after the other; it drops
bounds whose multiplier reaches zero. The cost only rises, so no active set comes twice. Active bounds are independent
at each step, so there are at most as many as variables. A step is a function without branches; compiled code repeats it
until no bound is violated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import casadi as ca

from rehab_opt.optim.certificate import certified_expressions, first_true
from rehab_opt.symbolic.matrices import solver_of, symmetric, triangle, upper_triangle

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Form

__all__ = ["STEPS", "TOGETHER", "active_set_round", "dual_active_set"]

BROKEN = 1e-11
"""Violation above which a bound becomes active; less is rounding."""
NESTED = 7
STEPS = NESTED**2
"""Largest number of bounds added or dropped; ticks near obstacles need up to 18."""
DEPENDENT = 1e-13
"""A bound depends on the active bounds if, while these hold, less than this fraction of its curvature remains.

For an independent bound, about 1e-12 and more remains; for a dependent one, rounding leaves 1e-16.
"""


def dual_active_set(form: Form) -> ca.Function:
    """Function (QP data) -> active bounds and rows (n + m,): 1 at the upper bound, -1 at the lower, else 0.

    Equalities are not marked. The cost must be strictly convex, and the equalities independent.
    """
    numbers = ca.MX.sym("numbers", form.build.numel_in(0))
    shared, state = _first(form)(numbers)
    step = _step(form)
    inputs = old, numbers, known = [ca.MX.sym("old", state.numel()), numbers, ca.MX.sym("known", shared.numel())]
    keep, steps = ca.Function("keep", inputs, [old]), ca.Function("step", inputs, [step(numbers, known, old)])
    for _ in range(2):  # nested: skipping each unused step takes longer than the few steps that are needed
        either, now = ca.Function.if_else("unless_done", keep, steps), old
        for _ in range(NESTED):
            now = either(now[-1], now, numbers, known)
        steps = ca.Function("steps", inputs, [now])
    state = steps(state, numbers, shared)
    return ca.Function("dual", [numbers], [state[: form.n + form.m]])


class _Numbers:
    """The QP as expressions of its data column; the bounds of x are the first rows."""

    def __init__(self, form: Form) -> None:
        n, m = form.n, form.m
        self.n, self.size = n, n + m
        self.numbers, (self.hessian, self.gradient, matrix, low, high, lower, upper) = form.symbols()
        self.rows = ca.vertcat(ca.SX.eye(n), ca.sparsify(matrix))
        self.low, self.high = ca.vertcat(lower, low), ca.vertcat(upper, high)
        self.equal = [n + i for i in form.rows()[0]]
        self.other = [i for i in range(n + m) if i not in self.equal]
        self.most = max(n - len(self.equal), 0)


class _State(NamedTuple):
    """State between steps. A normal is a signed row: normal . x <= limit. At most `most` bounds are active."""

    active: ca.SX
    """(n + m,) 1 or -1 where the upper or lower bound is in the active set."""
    x: ca.SX
    """(n,) solution for the equalities and the active set."""
    ways: ca.SX
    """(most, n) change of x, along the equalities, per unit multiplier of each active bound; unused rows are zero."""
    stiffness: ca.SX
    """(most (most + 1) / 2,) upper triangle of the products of normals and `ways`."""
    pushing: ca.SX
    """(most,) multipliers of the active bounds, not negative."""
    numbers: ca.SX
    """(most,) index of each active bound or row, counted from 1; 0 if unused."""
    pending: ca.SX
    """(n + m,) 1 or -1 for the bound that is being added."""
    begun: ca.SX
    """Multiplier that the bound being added has reached so far."""
    done: ca.SX
    """Whether no bound is violated, or none can be added."""

    def column(self) -> ca.SX:
        """State as one column; `_state_of` reads it."""
        return ca.densify(ca.vertcat(*(ca.vec(ca.densify(part)) for part in self)))


def _state_of(of: _Numbers) -> tuple[ca.SX, _State]:
    n, most, size = of.n, of.most, of.size
    shapes = [(size, 1), (n, 1), (most, n), (triangle(most), 1), (most, 1), (most, 1), (size, 1), (1, 1), (1, 1)]
    column = ca.SX.sym("state", sum(rows * columns for rows, columns in shapes))
    parts, at = [], 0
    for rows, columns in shapes:
        parts.append(ca.reshape(column[at : at + rows * columns], rows, columns))
        at += rows * columns
    return column, _State(*parts)


def _first(form: Form) -> ca.Function:
    """Function (QP data) -> inverses of the Hessian (for all x; along the equalities), and the first state."""
    of = _Numbers(form)
    n, most, size, rows = of.n, of.most, of.size, of.rows[of.equal, :]
    free = solver_of(of.hessian)(ca.SX.eye(n))
    along, x = free, -free @ of.gradient
    if of.equal:
        sideways = free @ rows.T
        held = solver_of(ca.triu2symm(ca.triu(rows @ sideways)))
        along = free - sideways @ held(sideways.T)
        x = x + sideways @ held(of.high[of.equal] - rows @ x)
    nothing, zero = ca.SX.zeros(size), ca.SX(0)
    none = ca.SX.zeros(most)
    state = _State(nothing, x, ca.SX.zeros(most, n), ca.SX.zeros(triangle(most)), none, none, nothing, zero, zero)
    shared = ca.densify(ca.vertcat(upper_triangle(free), upper_triangle(along)))
    return ca.Function("dual_first", [of.numbers], [shared, state.column()])


def _step(form: Form) -> ca.Function:
    """Function (QP data, inverses from `_first`, state) -> the next state."""
    of = _Numbers(form)
    n, most = of.n, of.most
    column, state = _state_of(of)
    shared = ca.SX.sym("shared", 2 * triangle(n))
    free, along = symmetric(shared[: triangle(n)], n), symmetric(shared[triangle(n) :], n)
    pending, broken = _next(of, state)
    normal = of.rows.T @ pending
    limit = ca.sum1(ca.if_else(pending > 0, of.high, ca.if_else(pending < 0, -of.low, 0)))

    # Direction of x as the new multiplier grows while the active bounds stay active.
    way, used = along @ normal, state.numbers > 0
    against = state.ways @ normal
    stiffness = symmetric(state.stiffness, most)
    change = -solver_of(stiffness + ca.diag(ca.logic_not(used)))(against)
    way_held = way + state.ways.T @ change
    curvature, rest = ca.dot(normal, free @ normal), ca.dot(normal, way_held)

    # Step until the new bound holds, or until the multiplier of an active bound reaches zero.
    enough = ca.if_else(rest > DEPENDENT * curvature, (ca.dot(normal, state.x) - limit) / rest, ca.inf)
    stops = ca.if_else(ca.logic_and(used, change < 0), -state.pushing / change, ca.inf)
    soonest = ca.mmin(stops)
    far = ca.fmin(enough, soonest)
    goes = ca.logic_and(broken, far < ca.inf)  # else x is the answer, or no x satisfies all bounds
    far = ca.if_else(goes, far, 0)
    held = ca.logic_and(goes, enough <= soonest)
    drops = ca.logic_and(goes, ca.logic_not(held))
    into, out = first_true(held * ca.logic_not(used)), first_true(drops * (stops <= soonest))
    stays = ca.logic_not(out)

    # A dropped bound leaves zeros, so a new one is simply added.
    added = into @ against.T
    products = ca.diag(stays) @ stiffness @ ca.diag(stays) + added + added.T + ca.diag(into * ca.dot(normal, way))
    pushing, begun = state.pushing + far * change, state.begun + far
    which = ca.dot(ca.fabs(pending), ca.DM(range(1, of.size + 1)))
    gone, active = ca.dot(out, state.numbers), ca.SX.zeros(of.size)
    for i in of.other:
        active[i] = (gone != i + 1) * state.active[i] + held * pending[i]
    following = _State(
        active=active,
        x=state.x - far * way_held,
        ways=ca.diag(stays) @ state.ways + into @ way.T,
        stiffness=upper_triangle(products),
        pushing=ca.if_else(out, 0, pushing) + into * begun,
        numbers=ca.if_else(out, 0, state.numbers) + into * which,
        pending=ca.if_else(held, 0, pending),
        begun=ca.if_else(held, 0, begun),
        done=ca.logic_not(goes),
    )
    inputs = [of.numbers, shared, column]
    return ca.Function("dual_step", inputs, [following.column()])


def _next(of: _Numbers, state: _State) -> tuple[ca.SX, ca.SX]:
    """Two results: (n + m,) with 1 or -1 at the bound to add, pending or most violated; whether there is one."""
    values = of.rows @ state.x
    above, below = values - of.high, of.low - values
    begun = ca.sumsqr(state.pending) > 0
    excess = ca.vertcat(*(ca.if_else(state.active[i] == 0, ca.fmax(above[i], below[i]), -1) for i in of.other))
    worst = ca.mmax(excess)
    new = ca.logic_and(ca.logic_not(begun), worst > BROKEN)
    hit = first_true(excess >= worst)
    pending = ca.SX.zeros(of.size)
    for k, i in enumerate(of.other):
        pending[i] = state.pending[i] + ca.if_else(ca.logic_and(new, hit[k]), ca.if_else(above[i] > below[i], 1, -1), 0)
    return pending, ca.logic_or(begun, new)


SOFTENED = 1e-9
"""Relative regularisation of active rows, so that dependent rows still give a solvable system."""
TOGETHER = 3
"""Largest number of active inequality rows; `dual_active_set` serves the rare cases with more."""


def active_set_round(form: Form, *, together: int, passes: int = 1, softened: float = SOFTENED) -> ca.Function:
    """Function (QP data, multipliers (n + m,)) -> x, multipliers and the certificate's residual, in one column.

    Bounds and rows with a multiplier, and all equalities, are taken as active. They give a linear system, which takes a
    few matrix products; the certificate judges its solution. At most the first `together` active inequality rows are
    used. `passes` correction steps undo the regularisation `softened`.
    """
    n, m, (numbers, data) = form.n, form.m, form.symbols()
    multipliers = ca.SX.sym("multipliers", n + m)
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper = data
    equalities, others = form.rows()

    low, high = ca.vertcat(lower, rows_lower), ca.vertcat(upper, rows_upper)
    at_high, at_low = multipliers > 0, multipliers < 0
    active = ca.logic_or(at_high, at_low)
    target = ca.if_else(at_high, high, ca.if_else(at_low, low, 0))

    taken = picked(active[n:][others], min(together, len(others), max(n - len(equalities), 0)))
    used = ca.vertcat(ca.SX.ones(len(equalities)), ca.sum2(taken))
    rows = ca.vertcat(matrix[equalities, :], taken @ matrix[others, :])
    wanted = ca.vertcat(rows_upper[equalities, :], taken @ target[n:, :][others, :])

    free, fixed = ca.diag(ca.logic_not(active[:n])), target[:n]
    solve = solver_of(free @ hessian @ free + ca.diag(active[:n]))
    sideways = solve(free @ rows.T)
    alone = fixed - solve(free @ (gradient + hessian @ fixed))
    stiffness = ca.triu2symm(ca.triu((rows @ free) @ sideways))  # half the entries need computing
    yielding = softened * ca.diag(stiffness)  # zero for a row whose variables are all fixed: no step can satisfy it
    held = solver_of(stiffness + ca.diag(ca.if_else(ca.logic_and(used, yielding > 0), yielding, 1)))
    pushing = held(rows @ alone - wanted)
    x = alone - sideways @ pushing
    for _ in range(passes):  # by the rows' error at x, since multipliers of nearly dependent rows are too large
        more = held(rows @ x - wanted)
        pushing, x = pushing + more, x - sideways @ more
    balance = ca.diag(active[:n]) @ -(hessian @ x + gradient + rows.T @ pushing)

    found = ca.SX.zeros(m)
    found[equalities, 0] = pushing[: len(equalities), 0]
    found[others, 0] = taken.T @ pushing[len(equalities) :, 0]
    x, residual = certified_expressions([*data, ca.SX(1)], x, balance, found)  # only valid parameters come here
    output = ca.densify(ca.vertcat(x, balance, found, residual))
    return ca.Function(f"round_{together}", [numbers, multipliers], [output])


def picked(active: ca.SX, count: int) -> ca.SX:
    """Matrix (count, rows) that selects the first `count` active rows; its unused rows are zero."""
    ranks, rank = [], ca.SX(0)
    if not count:
        return ca.SX(0, active.numel())
    for i in range(active.numel()):
        rank += active[i]
        ranks.append(rank)
    return ca.vertcat(
        *(
            ca.horzcat(*(ca.logic_and(active[i], ranks[i] == j + 1) for i in range(active.numel())))
            for j in range(count)
        )
    )
