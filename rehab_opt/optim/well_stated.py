"""What makes a statement a QP: a quadratic cost, linear rows, and no symbol that nobody gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.errors import ConfigurationError

if TYPE_CHECKING:
    from rehab_opt.optim.rows import Row

__all__ = ["check_that_it_is_a_qp", "with_numeric_bounds"]


def check_that_it_is_a_qp(
    name: str, cost: ca.SX, x: ca.SX, *, rows: Row, bounds: tuple[ca.SX, ca.SX], given: Sequence[ca.SX]
) -> None:
    """Say what is wrong with a statement over the variables x and what is given.

    Raises
    ------
    ConfigurationError : see `Statement`.
    """
    if cost.numel() != 1:
        raise ConfigurationError("minimise", cost.shape, "a scalar cost")
    told = {symbol.element_hash() for column in given for symbol in ca.vertsplit(column)}
    decided = {symbol.element_hash() for symbol in ca.vertsplit(x)}
    for argument, expression, known in (
        ("variables", ca.vertcat(*bounds), told),
        ("minimise", cost, told | decided),
        ("subject_to", ca.vertcat(*rows), told | decided),
    ):
        for symbol in ca.symvar(expression):
            if symbol.element_hash() not in known:
                raise ConfigurationError(argument, symbol.name(), "expressions of what is given before")
    if not ca.is_quadratic(cost, x):
        raise ConfigurationError("minimise", name, "a cost quadratic in the variables")
    if not ca.is_linear(rows.expression, x):
        raise ConfigurationError("subject_to", name, "rows linear in the variables")


def with_numeric_bounds(row: Row, x: ca.SX) -> Row:
    """The row with what its bounds hold of the variables moved to its left side; only an equality's may hold any."""
    if not (ca.depends_on(row.lower, x) or ca.depends_on(row.upper, x)):
        return row
    if not ca.is_equal(row.lower, row.upper, 50):
        raise ConfigurationError("subject_to", str(row.expression)[:60], "variables in a bound only of an equality")
    zeros = ca.SX.zeros(row.expression.numel())
    return row._replace(expression=row.expression - row.lower, lower=zeros, upper=zeros)
