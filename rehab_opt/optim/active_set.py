"""A QP's solution for a given active set: a few matrix products where a solver iterates.

From tick to tick the active bounds seldom change. Taken for equalities they leave a linear system, whose solution
counts only by its certificate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.certificate import certified_expressions
from rehab_opt.symbolic.matrices import solver_of

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Form

__all__ = ["TOGETHER", "active_set_round"]

SOFTENED = 1e-9
"""Share by which rows yield, so that dependent ones leave a system that can be solved."""
TOGETHER = 3
"""Inequality rows that may be active together; what needs more is seldom, and `dual_active_set` finds it."""


def active_set_round(form: Form, *, together: int, passes: int = 1, softened: float = SOFTENED) -> ca.Function:
    """Numbers, multipliers (n + m,) -> x, multipliers and the certificate's residual, one column.

    Bounds and rows with a multiplier are active, and so is every equality.

    Of the inequality rows, only the first `together` that are active are taken, and never more than can be independent.
    `passes` correct what `softened` takes away; where the rows are independent for certain, it can be tiny.
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
    wanted = ca.vertcat(rows_upper[equalities, :], taken @ target[n:][others])

    free, fixed = ca.diag(ca.logic_not(active[:n])), target[:n]
    solve = solver_of(free @ hessian @ free + ca.diag(active[:n]))
    sideways = solve(free @ rows.T)
    alone = fixed - solve(free @ (gradient + hessian @ fixed))
    stiffness = ca.triu2symm(ca.triu((rows @ free) @ sideways))  # half the entries need computing
    yielding = softened * ca.diag(stiffness)  # zero of a row over variables that are all held: nothing can meet it
    held = solver_of(stiffness + ca.diag(ca.if_else(ca.logic_and(used, yielding > 0), yielding, 1)))
    pushing = held(rows @ alone - wanted)
    x = alone - sideways @ pushing
    for _ in range(passes):  # on what x misses: multipliers of nearly dependent rows are too large to tell
        more = held(rows @ x - wanted)
        pushing, x = pushing + more, x - sideways @ more
    balance = ca.diag(active[:n]) @ -(hessian @ x + gradient + rows.T @ pushing)

    found = ca.SX.zeros(m)
    found[equalities, 0] = pushing[: len(equalities), 0]
    found[others, 0] = taken.T @ pushing[len(equalities) :, 0]
    x, residual = certified_expressions([*data, ca.SX(1)], x, balance, found)  # only sound parameters come here
    output = ca.densify(ca.vertcat(x, balance, found, residual))
    return ca.Function(f"round_{together}", [numbers, multipliers], [output])


def picked(active: ca.SX, count: int) -> ca.SX:
    """(count, rows) matrix that picks the first `count` active rows: one 1 a line, or none."""
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
