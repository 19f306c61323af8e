"""One tick in one function: kinematics, solve and certificate, without leaving compiled code.

An answer is looked for where it is cheapest, and certified wherever it was found: the statement's analytic answer, then
the bounds that were active in the last tick, then the solver.

CasADi's search for common subexpressions takes most of a function's making. It is not asked for where it finds a
hundredth or nothing, since the statement's numbers come without any.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.active_set import TOGETHER, active_set_round
from rehab_opt.optim.dual_active_set import dual_active_set
from rehab_opt.optim.equalities import dependent_equalities, inequality_rows
from rehab_opt.optim.qrqp import QRQP_ITERATIONS, qrqp
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
    (an index of `FUSED_SOLVERS`), and the statement's report. The solver is CasADi's qrqp, an active-set method that
    generates C.
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
    limits = (statement.lazy_rows, statement.active_set_iterations, statement.iterations)
    form = ("solve", statement.name, *limits, statement.build.serialize())
    return read_back(form, lambda: _made(statement))


def _made(statement: Statement) -> ca.Function:
    """What `_solve` gives, made of the statement."""
    solver = _qrqp(statement, statement.m)
    full, memory, start = _inputs(statement)
    if statement.lazy_rows:
        likely = _qrqp(statement, statement.m - statement.lazy_rows)(full, memory, start)
        choice = _choice(f"{statement.name}_likely", solver)
        answer = choice(likely[-2] <= ANALYTIC_TOLERANCE, likely, full, memory, start)
        solver = ca.Function(f"{statement.name}_any", [full, memory, start], [answer])
    if statement.active_set_iterations:
        answer = _rounds(statement, solver)(full, memory, start)
    elif statement.m:
        answer = solver(full, memory, start)
    else:
        x, bounds, residual = _last_active_set(statement)(full, memory, start[statement.n :])
        held = ca.vertcat(x, bounds, residual, 2)
        choice = _choice(f"{statement.name}_active_set", solver)
        answer = choice(residual <= ANALYTIC_TOLERANCE, held, full, memory, start)
    return ca.Function(f"{statement.name}_solve", [full, memory, start], [answer])


def _rounds(statement: Statement, solver: ca.Function) -> ca.Function:
    """As `solver`, after `active_set_round`s and `dual_active_set`, each only where what came before failed."""
    n = statement.n
    first, looking = _first_round(statement), active_set_round(statement, looking=True, together=TOGETHER)
    whole = active_set_round(statement, looking=False, together=n, passes=PASSES, softened=INDEPENDENT)
    full, memory, start = _inputs(statement)
    multipliers, point = ca.MX.sym("multipliers", n + statement.m), ca.MX.sym("point", n)
    arguments = [full, memory, start, multipliers, point]
    # What the rounds do not find, the slower method that cannot cycle does; a round makes its answer exact.
    dual, _ = whole(full, memory, dual_active_set(statement)(full, memory))
    choice = _choice(f"{statement.name}_dual_choice", solver)
    answer = choice(dual[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(dual, 3), full, memory, start)
    otherwise = ca.Function("solver", arguments, [answer])
    for k in reversed(range(statement.active_set_iterations)):
        found, following = looking(full, memory, multipliers, point) if k else first(full, memory, multipliers)
        choice = _choice(f"{statement.name}_round_{k}", otherwise)
        answer = choice(
            found[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(found, 2), full, memory, start, following, found[:n]
        )
        otherwise = ca.Function(f"{statement.name}_rounds_{k}", arguments, [answer])
    answer = otherwise(full, memory, start, start[n:], start[:n])
    return ca.Function(f"{statement.name}_rounds", [full, memory, start], [answer])


def _first_round(statement: Statement) -> ca.Function:
    """The round that only looks whether the same bounds are active again; half the work where no row was."""
    n, m = statement.n, statement.m
    full, memory, multipliers = *_inputs(statement)[:2], ca.MX.sym("multipliers", n + m)
    some, none = (active_set_round(statement, looking=False, together=together) for together in (TOGETHER, 0))
    either = ca.Function.if_else(f"{statement.name}_first_round", some, none)
    rows = multipliers[[n + i for i in inequality_rows(statement)]]
    answer = either(ca.sumsqr(rows) > 0, full, memory, multipliers)
    return ca.Function(f"{statement.name}_first", [full, memory, multipliers], list(answer))


def _last_active_set(statement: Statement) -> ca.Function:
    """Parameters, memory, last multipliers -> x, multipliers, residual if the same bounds are active again; m = 0."""
    n = statement.n
    full, memory = ca.SX.sym("full", statement.build.sparsity_in(0)), ca.SX.sym("memory", statement.memory.numel())
    multipliers = ca.SX.sym("multipliers", n)
    *data, _ = statement.build.call([full, memory])
    hessian, gradient, _, _, _, lower, upper = data
    at_upper, at_lower = multipliers > 0, multipliers < 0
    free = ca.logic_not(ca.logic_or(at_upper, at_lower))
    fixed = ca.if_else(at_upper, upper, ca.if_else(at_lower, lower, 0))
    # The free rows and columns of H, and the identity for the others, which keep their bound.
    masked = ca.diag(free) @ hessian @ ca.diag(free) + ca.diag(1 - free)
    diagonal, factor, order = ca.ldl(ca.densify(masked), False)
    x = ca.ldl_solve(fixed - free * (gradient + hessian @ fixed), diagonal, factor, order)
    balance = -(1 - free) * (hessian @ x + gradient)
    # Only sound parameters come here.
    x, residual = statement.certify.call([*data, ca.SX(1), x, balance, ca.SX(0, 1)])
    outputs = [ca.densify(each) for each in (x, balance, residual)]
    return ca.Function("last_active_set", [full, memory, multipliers], outputs)


def _qrqp(statement: Statement, m: int) -> ca.Function:
    """Complete parameters, memory, start -> x, multipliers, residual, who answered; with the first m rows only.

    The certificate is that of all rows.
    """
    n, all_rows = statement.n, statement.m
    full, memory, start = _inputs(statement)
    data = statement.build(full, memory)
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper, _ = data
    cap = statement.iterations or QRQP_ITERATIONS
    low, high, pushing = rows_lower, rows_upper, start[2 * n :]
    dependent = dependent_equalities(statement)
    if dependent is not None:
        let_go = dependent(full, memory)
        low, high = ca.if_else(let_go, -ca.inf, low), ca.if_else(let_go, ca.inf, high)
        pushing = ca.if_else(let_go, 0, pushing)
    solution = qrqp(f"{statement.name}_qp_{m}", n, m, iterations=cap)(
        h=hessian, g=gradient, a=matrix[:m, :], lba=low[:m], uba=high[:m], lbx=lower, ubx=upper,
        x0=start[:n], lam_x0=start[n : 2 * n], lam_a0=pushing[:m],
    )  # fmt: skip
    rows = ca.vertcat(solution["lam_a"], ca.MX.zeros(all_rows - m))
    x, residual = statement.certify(*data, solution["x"], solution["lam_x"], rows)
    answer = ca.vertcat(x, solution["lam_x"], rows, residual, 0)
    return ca.Function(f"{statement.name}_qrqp_{m}", [full, memory, start], [answer])


def _inputs(statement: Statement) -> list[ca.MX]:
    """Complete parameters, memory, start (x and multipliers)."""
    sizes = (statement.memory.numel(), 2 * statement.n + statement.m)
    return [ca.MX.sym("full", statement.build.sparsity_in(0)), *(ca.MX.sym("column", size) for size in sizes)]
