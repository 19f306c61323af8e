"""One tick in one function: kinematics, solve and certificate, without leaving compiled code.

An answer is looked for where it is cheapest, and certified wherever it was found: the statement's analytic answer, then
the bounds that were active in the last tick, then the dual active set method; or, for other statements than those of
velocities, CasADi's qrqp behind the analytic answer.

CasADi's search for common subexpressions takes most of a function's making. It is not asked for where it finds a
hundredth or nothing, since the statement's numbers come without any.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.active_set import TOGETHER, active_set_round
from rehab_opt.optim.dual_active_set import dual_active_set
from rehab_opt.optim.equalities import inequality_rows
from rehab_opt.optim.qrqp import qrqp
from rehab_opt.symbolic.shared import read_back

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Statement

__all__ = ["ANALYTIC_TOLERANCE", "FUSED_SOLVERS", "fused"]

FUSED_SOLVERS = ("qrqp", "closed form", "active set", "dual active set")
"""Who answered, by the number that the fused function gives."""
ANALYTIC_TOLERANCE = 1e-10
"""Residual to which an analytic answer counts as the answer: as exact as what the solver is asked for."""
INDEPENDENT = 1e-13
"""Share by which rows yield that the dual method found: they are independent by more than this."""
PASSES = 2
"""Corrections of what that takes away."""


def fused(statement: Statement) -> ca.Function:
    """Parameters, state -> state, verdict.

    A state stacks x (n,), the multipliers of its bounds (n,) and of the rows (m,), and the memory: the warm start and
    all that is known of the last tick. The verdict stacks the residual, whether the parameters are sound, who answered
    (an index of `FUSED_SOLVERS`), and the statement's report. All of it generates C.
    """
    n, m, size = statement.n, statement.m, statement.state_size
    p, last = ca.MX.sym("p", statement.parameter_size), ca.MX.sym("last", size)
    start, memory = last[: 2 * n + m], last[2 * n + m :]
    full = statement.complete(p, memory)
    analytic, residual, sound = statement.screen(full, memory)

    held = ca.vertcat(analytic, residual, 1)
    answered = ca.logic_or(residual <= ANALYTIC_TOLERANCE, ca.logic_not(sound))  # no solver sees unusable parameters
    answer = _choice(f"{statement.name}_closed_form", _solve(statement))(answered, held, full, memory, start)

    x = answer[:n]
    report, after, violation = statement.finish(full, memory, x)
    state = ca.vertcat(answer[: 2 * n + m], after)
    verdict = ca.vertcat(answer[-2] + violation, sound, answer[-1], report)
    return ca.Function(statement.name, [p, last], [state, verdict])


def _choice(name: str, otherwise: ca.Function) -> ca.Function:
    """Condition, held, arguments -> held where the condition is true, else what `otherwise` gives for the arguments."""
    held = ca.MX.sym("held", otherwise.sparsity_out(0))
    arguments = [ca.MX.sym("argument", otherwise.sparsity_in(i)) for i in range(otherwise.n_in())]
    keep = ca.Function("keep", [held, *arguments], [held])
    go_on = ca.Function("go_on", [held, *arguments], otherwise.call(arguments))
    return ca.Function.if_else(name, keep, go_on)


def _solve(statement: Statement) -> ca.Function:
    """Complete parameters, memory, start -> x, multipliers, residual, who answered.

    It is most of a controller's making, and depends on the QP's form alone.
    """
    form = ("solve", statement.name, statement.active_set, statement.build.serialize())
    return read_back(form, lambda: _made(statement))


def _made(statement: Statement) -> ca.Function:
    """What `_solve` gives, made of the statement."""
    if not statement.active_set:
        return _qrqp(statement)
    full, memory, start = _inputs(statement)
    found = _last_active_set(statement)(full, memory, start[statement.n :])
    answer = _choice(f"{statement.name}_choice", _dual_active_set(statement))(
        found[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(found, 2), full, memory
    )
    return ca.Function(f"{statement.name}_solve", [full, memory, start], [answer])


def _dual_active_set(statement: Statement) -> ca.Function:
    """Complete parameters, memory -> x, multipliers, residual, who answered; a round makes what it finds exact."""
    full, memory, _ = _inputs(statement)
    exact = active_set_round(statement, together=statement.n, passes=PASSES, softened=INDEPENDENT)
    answer = ca.vertcat(exact(full, memory, dual_active_set(statement)(full, memory)), 3)
    return ca.Function(f"{statement.name}_by_dual", [full, memory], [answer])


def _last_active_set(statement: Statement) -> ca.Function:
    """The round with the bounds that were active in the last tick; half the work where no row was."""
    n, m = statement.n, statement.m
    full, memory, multipliers = *_inputs(statement)[:2], ca.MX.sym("multipliers", n + m)
    some, none = (active_set_round(statement, together=together) for together in (TOGETHER, 0))
    if not m:
        return none
    either = ca.Function.if_else(f"{statement.name}_last_either", some, none)
    rows = multipliers[[n + i for i in inequality_rows(statement)]]
    answer = either(ca.sumsqr(rows) > 0, full, memory, multipliers)
    return ca.Function(f"{statement.name}_last", [full, memory, multipliers], [answer])


def _qrqp(statement: Statement) -> ca.Function:
    """Complete parameters, memory, start -> x, multipliers, residual, who answered."""
    n, m = statement.n, statement.m
    full, memory, start = _inputs(statement)
    data = statement.build(full, memory)
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper, _ = data
    solution = qrqp(f"{statement.name}_qp", n, m)(
        h=hessian, g=gradient, a=matrix, lba=rows_lower, uba=rows_upper, lbx=lower, ubx=upper,
        x0=start[:n], lam_x0=start[n : 2 * n], lam_a0=start[2 * n :],
    )  # fmt: skip
    x, residual = statement.certify(*data, solution["x"], solution["lam_x"], solution["lam_a"])
    answer = ca.vertcat(x, solution["lam_x"], solution["lam_a"], residual, 0)
    return ca.Function(f"{statement.name}_qrqp", [full, memory, start], [answer])


def _inputs(statement: Statement) -> list[ca.MX]:
    """Complete parameters, memory, start (x and multipliers)."""
    sizes = (statement.memory.numel(), 2 * statement.n + statement.m)
    return [ca.MX.sym("full", statement.build.sparsity_in(0)), *(ca.MX.sym("column", size) for size in sizes)]
