"""One tick in one function: kinematics, solve and certificate, without leaving compiled code.

Candidates are certified in order of their cost: the statement's analytic answer; if the statement has `active_set`, the
answer for the last tick's active bounds, and that of the dual active set method; CasADi's qrqp.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.dual_active_set import TOGETHER, active_set_round, dual_active_set
from rehab_opt.optim.qrqp import qrqp
from rehab_opt.symbolic.shared import remembered

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Form, Statement

__all__ = ["ANALYTIC_TOLERANCE", "FUSED_SOLVERS", "by_dual_active_set", "choice", "exact_round", "fused"]

FUSED_SOLVERS = ("qrqp", "closed form", "active set", "dual active set")
"""Names of the solvers by the number that the fused function returns."""
ANALYTIC_TOLERANCE = 1e-10
"""Largest residual of an accepted analytic answer; equal to the solvers' tolerance."""
INDEPENDENT = 1e-13
"""Relative regularisation of rows that the dual method chose; such rows are independent."""
PASSES = 2
"""Number of correction steps that undo this regularisation."""


def fused(statement: Statement) -> ca.Function:
    """Function (parameters, state) -> the next state, and the verdict on it.

    A state stacks x (n,), the multipliers of its bounds (n,) and of the rows (m,), and the memory: the warm start and
    the results of the last tick. The verdict stacks the residual, whether the parameters are valid, the index in
    `FUSED_SOLVERS` of the solver that answered, and the statement's report. The function generates C.
    """
    n, m, size = statement.n, statement.m, statement.state_size
    p, last = ca.MX.sym("p", statement.parameter_size), ca.MX.sym("last", size)
    start, memory = last[: 2 * n + m], last[2 * n + m :]
    full = statement.complete(p, memory)
    analytic, residual, valid = statement.screen(full, memory)

    held = ca.vertcat(analytic, residual, 1)
    answered = ca.logic_or(residual <= ANALYTIC_TOLERANCE, ca.logic_not(valid))  # no solver sees invalid parameters
    answer = choice(f"{statement.name}_closed_form", _solve(statement))(answered, held, full, memory, start)

    x = answer[:n]
    report, after, violation = statement.finish(full, memory, x)
    state = ca.vertcat(answer[: 2 * n + m], after)
    verdict = ca.vertcat(answer[-2] + violation, valid, answer[-1], report)
    return ca.Function(statement.name, [p, last], [state, verdict])


def choice(name: str, otherwise: ca.Function) -> ca.Function:
    """Function (condition, held, arguments) -> `held` if the condition is true, else `otherwise(arguments)`."""
    held = ca.MX.sym("held", otherwise.sparsity_out(0))
    arguments = [ca.MX.sym("argument", otherwise.sparsity_in(i)) for i in range(otherwise.n_in())]
    keep = ca.Function("keep", [held, *arguments], [held])
    go_on = ca.Function("go_on", [held, *arguments], otherwise.call(arguments))
    return ca.Function.if_else(name, keep, go_on)


def _solve(statement: Statement) -> ca.Function:
    """Function (complete parameters, memory, start) -> x, multipliers, residual, solver index; cached by form."""
    form, numbers = statement.form()
    solve = remembered((*form[:-2], form.build.serialize()), lambda: _made(form))
    full, memory = (ca.MX.sym("column", statement.build.numel_in(i)) for i in range(2))
    start = _inputs(form)[1]
    return ca.Function("solve", [full, memory, start], [solve(numbers(full, memory), start)])


def _made(form: Form) -> ca.Function:
    """Function (QP data, start) -> x, multipliers, residual and solver index, by the solvers in their order."""
    if not form.active_set:
        return _qrqp(form)
    numbers, start = _inputs(form)
    dual = by_dual_active_set(form, exact_round(form))(numbers)
    # qrqp answers if the rows leave only a corner of the bounds: there rounding ends the dual method outside.
    answer = choice("qrqp", _qrqp(form))(dual[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(dual, 3), numbers, start)
    by_solvers = ca.Function("by_solvers", [numbers, start], [answer])
    last = _last_active_set(form)(numbers, start[form.n :])
    answer = choice("last", by_solvers)(last[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(last, 2), numbers, start)
    return ca.Function("solver", [numbers, start], [answer])


def _last_active_set(form: Form) -> ca.Function:
    """Function (QP data, multipliers) -> solution with the last tick's active bounds; cheaper if no row was active."""
    some, none = (active_set_round(form, together=together) for together in (TOGETHER, 0))
    if not form.m:
        return none
    numbers, multipliers = _inputs(form)[0], ca.MX.sym("multipliers", form.n + form.m)
    rows = multipliers[[form.n + i for i in form.rows()[1]]]
    answer = ca.Function.if_else("last_either", some, none)(ca.sumsqr(rows) > 0, numbers, multipliers)
    return ca.Function("last", [numbers, multipliers], [answer])


def exact_round(form: Form) -> ca.Function:
    """`active_set_round` for active bounds that are linearly independent."""
    return active_set_round(form, together=form.n, passes=PASSES, softened=INDEPENDENT)


def by_dual_active_set(form: Form, exact: ca.Function) -> ca.Function:
    """Function (QP data) -> x, multipliers and residual: the dual method's result, refined by `exact_round`."""
    numbers, _ = _inputs(form)
    return ca.Function("by_dual", [numbers], [exact(numbers, dual_active_set(form)(numbers))])


def _qrqp(form: Form) -> ca.Function:
    """Function (QP data, start) -> x, multipliers, residual and solver index, by qrqp."""
    n, m, (numbers, start) = form.n, form.m, _inputs(form)
    qp = form.build(numbers)
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper = qp
    solution = qrqp("qp", n, m)(
        h=hessian, g=gradient, a=matrix, lba=rows_lower, uba=rows_upper, lbx=lower, ubx=upper,
        x0=start[:n], lam_x0=start[n : 2 * n], lam_a0=start[2 * n :],
    )  # fmt: skip
    x, residual = form.certify(*qp, 1, solution["x"], solution["lam_x"], solution["lam_a"])
    answer = ca.vertcat(x, solution["lam_x"], solution["lam_a"], residual, 0)
    return ca.Function("qrqp", [numbers, start], [answer])


def _inputs(form: Form) -> list[ca.MX]:
    """Symbols for the QP data, and for the start: x and multipliers."""
    return [ca.MX.sym("column", size) for size in (form.build.numel_in(0), 2 * form.n + form.m)]
