"""Equality rows of a statement."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from rehab_opt.optim.qp import Statement

__all__ = ["equality_rows", "inequality_rows"]


def equality_rows(rows_lower: ca.SX, rows_upper: ca.SX) -> list[int]:
    """Indices of the rows whose bounds are one expression."""
    return [i for i in range(rows_lower.numel()) if ca.is_equal(rows_lower[i], rows_upper[i], 10)]


def inequality_rows(statement: Statement) -> list[int]:
    """Indices of a statement's other rows."""
    full, memory = ca.SX.sym("full", statement.build.sparsity_in(0)), ca.SX.sym("memory", statement.memory.numel())
    *_, rows_lower, rows_upper, _, _, _ = statement.build.call([full, memory])
    equalities = equality_rows(rows_lower, rows_upper)
    return [i for i in range(statement.m) if i not in equalities]
