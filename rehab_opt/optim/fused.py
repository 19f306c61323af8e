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
from rehab_opt.optim.qrqp import QRQP_ITERATIONS, qrqp
from rehab_opt.symbolic.shared import remembered

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Form, Statement

__all__ = ["ANALYTIC_TOLERANCE", "FUSED_SOLVERS", "dependent_equalities", "fused"]

FUSED_SOLVERS = ("qrqp", "closed form", "active set", "dual active set")
"""Who answered, by the number that the fused function gives."""
ANALYTIC_TOLERANCE = 1e-10
"""Residual to which an analytic answer counts as the answer: as exact as what the solver is asked for."""
INDEPENDENT = 1e-13
"""Share by which rows yield that the dual method found: they are independent by more than this."""
DEPENDENT = 1e-10
"""Share of an equality that must be left beside those before it; rounding leaves 1e-15."""
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

    A third of a controller's making, which depends on the QP's form alone.
    """
    form, numbers = statement.form()
    solve = remembered((*form[:-2], form.build.serialize()), lambda: _made(form))
    full, memory = (ca.MX.sym("column", statement.build.numel_in(i)) for i in range(2))
    start = _inputs(form)[1]
    return ca.Function("solve", [full, memory, start], [solve(numbers(full, memory), start)])


def _made(form: Form) -> ca.Function:
    """Numbers, start -> what `_solve` gives."""
    solver = _qrqp(form, form.m)
    numbers, start = _inputs(form)
    if form.lazy_rows:
        likely = _qrqp(form, form.m - form.lazy_rows)(numbers, start)
        choice = _choice("likely", solver)
        answer = choice(likely[-2] <= ANALYTIC_TOLERANCE, likely, numbers, start)
        solver = ca.Function("any", [numbers, start], [answer])
    if form.active_set_iterations:
        answer = _rounds(form, solver)(numbers, start)
    elif form.m:
        answer = solver(numbers, start)
    else:
        x, bounds, residual = _last_active_set(form)(numbers, start[form.n :])
        held = ca.vertcat(x, bounds, residual, 2)
        choice = _choice("active_set", solver)
        answer = choice(residual <= ANALYTIC_TOLERANCE, held, numbers, start)
    return ca.Function("solver", [numbers, start], [answer])


def _rounds(form: Form, solver: ca.Function) -> ca.Function:
    """As `solver`, after `active_set_round`s and `dual_active_set`, each only where what came before failed."""
    n = form.n
    first, looking = _first_round(form), active_set_round(form, looking=True, together=TOGETHER)
    whole = active_set_round(form, looking=False, together=n, passes=PASSES, softened=INDEPENDENT)
    numbers, start = _inputs(form)
    multipliers, point = ca.MX.sym("multipliers", n + form.m), ca.MX.sym("point", n)
    arguments = [numbers, start, multipliers, point]
    # What the rounds do not find, the slower method that cannot cycle does; a round makes its answer exact.
    dual, _ = whole(numbers, dual_active_set(form)(numbers))
    choice = _choice("dual_choice", solver)
    answer = choice(dual[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(dual, 3), numbers, start)
    otherwise = ca.Function("solver", arguments, [answer])
    for k in reversed(range(form.active_set_iterations)):
        found, following = looking(numbers, multipliers, point) if k else first(numbers, multipliers)
        choice = _choice(f"round_{k}", otherwise)
        answer = choice(found[-1] <= ANALYTIC_TOLERANCE, ca.vertcat(found, 2), numbers, start, following, found[:n])
        otherwise = ca.Function(f"rounds_{k}", arguments, [answer])
    answer = otherwise(numbers, start, start[n:], start[:n])
    return ca.Function("rounds", [numbers, start], [answer])


def _first_round(form: Form) -> ca.Function:
    """The round that only looks whether the same bounds are active again; half the work where no row was."""
    numbers, multipliers = _inputs(form)[0], ca.MX.sym("multipliers", form.n + form.m)
    some, none = (active_set_round(form, looking=False, together=together) for together in (TOGETHER, 0))
    either = ca.Function.if_else("first_round", some, none)
    rows = multipliers[[form.n + i for i in form.rows()[1]]]
    answer = either(ca.sumsqr(rows) > 0, numbers, multipliers)
    return ca.Function("first", [numbers, multipliers], list(answer))


def _last_active_set(form: Form) -> ca.Function:
    """Numbers, last multipliers -> x, multipliers, residual if the same bounds are active again; m = 0."""
    (numbers, qp), multipliers = form.symbols(), ca.SX.sym("multipliers", form.n)
    hessian, gradient, _, _, _, lower, upper = qp
    at_upper, at_lower = multipliers > 0, multipliers < 0
    free = ca.logic_not(ca.logic_or(at_upper, at_lower))
    fixed = ca.if_else(at_upper, upper, ca.if_else(at_lower, lower, 0))
    # The free rows and columns of H, and the identity for the others, which keep their bound.
    masked = ca.diag(free) @ hessian @ ca.diag(free) + ca.diag(1 - free)
    diagonal, factor, order = ca.ldl(ca.densify(masked), False)
    x = ca.ldl_solve(fixed - free * (gradient + hessian @ fixed), diagonal, factor, order)
    balance = -(1 - free) * (hessian @ x + gradient)
    x, residual = form.certify.call([*qp, ca.SX(1), x, balance, ca.SX(0, 1)])
    outputs = [ca.densify(each) for each in (x, balance, residual)]
    return ca.Function("last_active_set", [numbers, multipliers], outputs)


def _qrqp(form: Form, m: int) -> ca.Function:
    """Numbers, start -> x, multipliers, residual, who answered; with the first m rows only.

    The certificate is that of all rows.
    """
    n, all_rows = form.n, form.m
    numbers, start = _inputs(form)
    qp = form.build(numbers)
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper = qp
    cap = form.iterations or QRQP_ITERATIONS
    low, high, pushing = rows_lower, rows_upper, start[2 * n :]
    dependent = dependent_equalities(form)
    if dependent is not None:
        let_go = dependent(numbers)
        low, high = ca.if_else(let_go, -ca.inf, low), ca.if_else(let_go, ca.inf, high)
        pushing = ca.if_else(let_go, 0, pushing)
    solution = qrqp(f"qp_{m}", n, m, iterations=cap)(
        h=hessian, g=gradient, a=matrix[:m, :], lba=low[:m], uba=high[:m], lbx=lower, ubx=upper,
        x0=start[:n], lam_x0=start[n : 2 * n], lam_a0=pushing[:m],
    )  # fmt: skip
    rows = ca.vertcat(solution["lam_a"], ca.MX.zeros(all_rows - m))
    x, residual = form.certify(*qp, 1, solution["x"], solution["lam_x"], rows)
    answer = ca.vertcat(x, solution["lam_x"], rows, residual, 0)
    return ca.Function(f"qrqp_{m}", [numbers, start], [answer])


def dependent_equalities(form: Form) -> ca.Function | None:
    """Numbers -> (m,) 1 for an equality that depends on those before it, and held variables; None without equalities.

    qrqp fails on these: it does not see them, and the certificate, which has every row, tells whether rows contradict
    each other. By Gram and Schmidt over the columns of the variables that can move.
    """
    (equalities, _), (numbers, (_, _, matrix, _, _, lower, upper)) = form.rows(), form.symbols()
    if not equalities:
        return None
    moves = lower < upper
    dependent, directions = ca.SX.zeros(form.m), list[ca.SX]()
    for i in equalities:
        left = matrix[i, :].T * moves
        for direction in directions:
            left -= direction * ca.dot(direction, left)
        new = ca.sumsqr(left) > DEPENDENT**2 * ca.sumsqr(matrix[i, :])
        directions.append(ca.if_else(new, left / ca.norm_2(left), 0))
        dependent[i] = ca.logic_not(new)
    return ca.Function("dependent", [numbers], [ca.densify(dependent)], {"cse": True})


def _inputs(form: Form) -> list[ca.MX]:
    """Numbers; start: x and multipliers."""
    return [ca.MX.sym("column", size) for size in (form.build.numel_in(0), 2 * form.n + form.m)]
