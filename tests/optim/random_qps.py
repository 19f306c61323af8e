"""Random feasible QPs as plain numbers, and their solutions by an independent solver used without our adapters."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import qpsolvers
from hypothesis import strategies as st
from numpy.typing import NDArray

from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import Instance, parameter, variable, within

Array = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)
sizes = st.tuples(st.integers(1, 7), st.integers(0, 5))


class Solution(NamedTuple):
    x: Array
    bounds: Array
    """Multipliers of the bounds, positive at an upper one."""
    rows: Array


def random_qp(seed: int, n: int, m: int, *, unbounded: bool = True) -> Instance:
    """Strictly convex and feasible: equality rows, one-sided rows, fixed and unbounded variables occur."""
    rng = np.random.default_rng(seed)
    root, matrix, inside = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
    far = np.inf if unbounded else 1e3
    lower, upper = inside - rng.exponential(0.5, n), inside + rng.exponential(0.5, n)
    for side, sign in ((lower, -1), (upper, 1)):
        side[rng.random(n) < 0.2] = sign * far
    fixed = rng.random(n) < 0.15
    lower[fixed] = upper[fixed] = inside[fixed]
    middle = matrix @ inside
    rows_lower, rows_upper = middle - rng.exponential(0.5, m), middle + rng.exponential(0.5, m)
    kind = rng.integers(0, 4, m)
    kind[np.cumsum(kind == 0) > max(0, n - fixed.sum() - 1)] = 1  # no more equalities than the free variables can keep
    rows_lower[kind == 0] = rows_upper[kind == 0] = middle[kind == 0]
    rows_lower[kind == 2], rows_upper[kind == 3] = -far, far
    return Instance(root @ root.T + np.eye(n), 3 * rng.normal(size=n), matrix, rows_lower, rows_upper, lower, upper)


def solved(qp: Instance, solver: str = "daqp") -> Solution:
    """By a dual active-set method; its multipliers put back where the rows and bounds stand."""
    equal = qp.rows_lower == qp.rows_upper
    above, below = ~equal & np.isfinite(qp.rows_upper), ~equal & np.isfinite(qp.rows_lower)
    inequalities = np.vstack([qp.A[above], -qp.A[below]])
    limits = np.concatenate([qp.rows_upper[above], -qp.rows_lower[below]])
    problem = qpsolvers.Problem(
        qp.H, qp.g, inequalities if limits.size else None, limits if limits.size else None,
        qp.A[equal] if equal.any() else None, qp.rows_upper[equal] if equal.any() else None, qp.lower, qp.upper,
    )  # fmt: skip
    options = {"primal_tol": 1e-12, "dual_tol": 1e-12} if solver == "daqp" else {}
    solution = qpsolvers.solve_problem(problem, solver=solver, **options)
    assert solution.found
    rows = np.zeros(equal.size)
    if equal.any():
        rows[equal] = solution.y
    if limits.size:
        rows[above] += solution.z[: above.sum()]
        rows[below] -= solution.z[above.sum() :]
    return Solution(solution.x, solution.z_box, rows)


def general_statement(n: int, m: int) -> Statement:
    """Every number of the QP is a parameter; `parameters_of` gives them in order."""
    h, g, a = parameter("h", n * n), parameter("g", n), parameter("a", m * n)
    rows, bounds = parameter("rows", 2 * m), parameter("bounds", 2 * n)
    x = variable("x", n, lower=bounds[:n], upper=bounds[n:])
    cost = 0.5 * x.symbol.T @ ca.reshape(h, n, n) @ x.symbol + g.T @ x.symbol
    lines = [within(ca.reshape(a, m, n) @ x.symbol, rows[:m], rows[m:])] if m else []
    return Statement("general", [h, g, a, rows, bounds], [x], cost, lines)


def parameters_of(qp: Instance) -> Array:
    return np.concatenate(
        [
            qp.H.reshape(-1, order="F"), qp.g, qp.A.reshape(-1, order="F"),
            qp.rows_lower, qp.rows_upper, qp.lower, qp.upper,
        ]
    )  # fmt: skip
