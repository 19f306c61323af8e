"""One tick in one function: kinematics, solve and certificate, without leaving compiled code.

An answer is looked for where it is cheapest, and certified wherever it was found: the statement's guess (no bound
active), then the bounds that were active in the last tick, then the solver.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.qrqp import qrqp

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Statement

__all__ = ["FUSED_SOLVERS", "GUESS_TOLERANCE", "fused"]

FUSED_SOLVERS = ("qrqp", "closed form", "active set")
"""Who answered, by the number that the fused function gives."""
GUESS_TOLERANCE = 1e-10
"""Residual to which a guess counts as the answer: as exact as what the solver is asked for."""


def fused(statement: Statement) -> ca.Function:
    """Parameters, state -> state, verdict.

    A state stacks x (n,), the multipliers of its bounds (n,) and of the rows (m,), and the memory: the warm start and
    all that is known of the last tick. The verdict stacks the residual, whether the parameters are sound, who answered
    (an index of `FUSED_SOLVERS`), and the statement's report. The solver is CasADi's qrqp, an active-set method that
    generates C.
    """
    n, m = statement.n, statement.m
    p, last = ca.MX.sym("p", statement.parameter_size), ca.MX.sym("last", statement.state_size)
    start, memory = last[: 2 * n + m], last[2 * n + m :]
    full = statement.complete(p, memory)
    *data, guess = statement.build(full, memory)

    attempt = _solve(statement)
    if m == 0:
        attempt = _unless_certified(statement, "active_set", _last_active_set(statement), 2, attempt)
    if statement.guess is not None:
        attempt = _unless_certified(statement, "closed_form", _guessed(statement), 1, attempt)
    attempt = ca.Function.if_else(f"{statement.name}_sound", attempt, _refused(statement))
    answer = attempt(data[-1], guess, start, *data)

    x = answer[:n]
    report, memory = statement.finish(full, memory, x)
    verdict = ca.vertcat(answer[-2], data[-1], answer[-1], report)
    return ca.Function(statement.name, [p, last], [ca.vertcat(answer[: 2 * n + m], memory), verdict])


def _unless_certified(
    statement: Statement, name: str, candidate: ca.Function, number: int, otherwise: ca.Function
) -> ca.Function:
    """Guess, start, data -> the candidate's answer where it is certified, else what `otherwise` answers."""
    inputs = _inputs(statement)
    _, _, *data = inputs
    x, bounds = candidate(*inputs)
    rows = ca.MX.zeros(statement.m)
    x, residual = statement.certify(*data, x, bounds, rows)
    held = ca.vertcat(x, bounds, rows, residual, number)
    symbol = ca.MX.sym("held", held.numel())
    keep = ca.Function("keep", [symbol, *inputs], [symbol])
    go_on = ca.Function("go_on", [symbol, *inputs], [otherwise(*inputs)])
    choice = ca.Function.if_else(f"{statement.name}_{name}_choice", keep, go_on)
    return ca.Function(f"{statement.name}_{name}", inputs, [choice(residual <= GUESS_TOLERANCE, held, *inputs)])


def _guessed(statement: Statement) -> ca.Function:
    """Guess, start, data -> the guess, with no bound active."""
    guess, start, *data = _inputs(statement)
    return ca.Function("guessed", [guess, start, *data], [guess, ca.MX.zeros(statement.n)])


def _last_active_set(statement: Statement) -> ca.Function:
    """Guess, start, data -> x and multipliers if the bounds that were active in the last tick still are; m = 0."""
    n = statement.n
    hessian, gradient, lower, upper = (ca.SX.sym("data", *shape) for shape in ((n, n), (n, 1), (n, 1), (n, 1)))
    multipliers = ca.SX.sym("multipliers", n)
    at_upper, at_lower = multipliers > 0, multipliers < 0
    free = ca.logic_not(ca.logic_or(at_upper, at_lower))
    fixed = ca.if_else(at_upper, upper, ca.if_else(at_lower, lower, 0))
    # The free rows and columns of H, and the identity for the others, which keep their bound.
    masked = ca.diag(free) @ hessian @ ca.diag(free) + ca.diag(1 - free)
    diagonal, factor, order = ca.ldl(ca.densify(masked), False)
    x = ca.ldl_solve(fixed - free * (gradient + hessian @ fixed), diagonal, factor, order)
    balance = -(1 - free) * (hessian @ x + gradient)
    solve = ca.Function("solve", [hessian, gradient, lower, upper, multipliers], [x, balance], {"cse": True})

    inputs = _inputs(statement)
    _, start, h, g, _, _, _, low, high, _ = inputs
    return ca.Function("last_active_set", inputs, list(solve(h, g, low, high, start[n : 2 * n])))


def _solve(statement: Statement) -> ca.Function:
    """Guess, start, data -> x, multipliers, residual and number of qrqp."""
    n = statement.n
    inputs = _inputs(statement)
    _, start, *data = inputs
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper, _ = data
    solution = qrqp(f"{statement.name}_qp", n, statement.m)(
        h=hessian, g=gradient, a=matrix, lba=rows_lower, uba=rows_upper, lbx=lower, ubx=upper,
        x0=start[:n], lam_x0=start[n : 2 * n], lam_a0=start[2 * n :],
    )  # fmt: skip
    x, residual = statement.certify(*data, solution["x"], solution["lam_x"], solution["lam_a"])
    answer = ca.vertcat(x, solution["lam_x"], solution["lam_a"], residual, 0)
    return ca.Function(f"{statement.name}_solve", inputs, [answer])


def _refused(statement: Statement) -> ca.Function:
    """Guess, start, data -> nothing, with an infinite residual: no solver sees parameters that cannot be used."""
    inputs = _inputs(statement)
    nothing = ca.MX(ca.DM([0.0] * (2 * statement.n + statement.m) + [ca.inf, 0.0]))
    return ca.Function(f"{statement.name}_refused", inputs, [nothing])


def _inputs(statement: Statement) -> list[ca.MX]:
    """Guess (n,), start (2 n + m,), and the first eight outputs of `Statement.build`."""
    build = statement.build
    data = [ca.MX.sym("data", build.sparsity_out(i)) for i in range(8)]
    return [ca.MX.sym("guess", statement.n), ca.MX.sym("start", 2 * statement.n + statement.m), *data]
