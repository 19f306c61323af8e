"""Equality rows of a statement, and which of them are redundant.

qrqp fails where equalities depend on each other: a row that stands twice, or one over variables that their bounds hold
already. What a row says that depends on others, those say; it is let go before the solver sees it, and the certificate,
which has every row, tells whether they contradict each other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Statement

__all__ = ["DEPENDENT", "dependent_equalities", "equality_rows", "inequality_rows"]

DEPENDENT = 1e-10
"""Share of a row's length that must be left beside the rows before it; rounding leaves 1e-15."""


def equality_rows(rows_lower: ca.SX, rows_upper: ca.SX) -> list[int]:
    """Indices of the rows whose bounds are one expression."""
    return [i for i in range(rows_lower.numel()) if ca.is_equal(rows_lower[i], rows_upper[i], 10)]


def inequality_rows(statement: Statement) -> list[int]:
    """Indices of a statement's other rows."""
    full, memory = ca.SX.sym("full", statement.build.sparsity_in(0)), ca.SX.sym("memory", statement.memory.numel())
    *_, rows_lower, rows_upper, _, _, _ = statement.build.call([full, memory])
    equalities = equality_rows(rows_lower, rows_upper)
    return [i for i in range(statement.m) if i not in equalities]


def dependent_equalities(statement: Statement) -> ca.Function | None:
    """Complete parameters, memory -> (m,) 1 for an equality that depends on those before it, and on held variables.

    None where the statement has no equality. By Gram and Schmidt over the columns of the variables that can move.
    """
    full, memory = ca.SX.sym("full", statement.build.sparsity_in(0)), ca.SX.sym("memory", statement.memory.numel())
    _, _, matrix, rows_lower, rows_upper, lower, upper, _ = statement.build.call([full, memory])
    equalities = equality_rows(rows_lower, rows_upper)
    if not equalities:
        return None
    moves = lower < upper
    dependent, directions = ca.SX.zeros(statement.m), list[ca.SX]()
    for i in equalities:
        left = matrix[i, :].T * moves
        for direction in directions:
            left -= direction * ca.dot(direction, left)
        new = ca.sumsqr(left) > DEPENDENT**2 * ca.sumsqr(matrix[i, :])
        directions.append(ca.if_else(new, left / ca.norm_2(left), 0))
        dependent[i] = ca.logic_not(new)
    outputs = [ca.densify(dependent)]
    return ca.Function(f"{statement.name}_dependent", [full, memory], outputs, {"cse": True})
