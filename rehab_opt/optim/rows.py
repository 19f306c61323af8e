"""Elements of a QP: variables and rows as expressions, a QP as numbers, and a check of both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError

__all__ = [
    "MAX_MAGNITUDE", "Instance", "Row", "Variable", "check_that_it_is_a_qp", "equal", "parameter", "variable",
    "with_numeric_bounds", "within",
]  # fmt: skip

Array = NDArray[np.float64]

MAX_MAGNITUDE = 1e6
"""Largest magnitude of a parameter, in SI units; a larger one comes from a broken sensor or caller."""


class Variable(NamedTuple):
    """Decision variables with their bounds; made by `variable`."""

    symbol: ca.SX
    lower: ca.SX
    upper: ca.SX


class Row(NamedTuple):
    """lower <= expression <= upper, linear in the variables; made by `equal` and `within`."""

    expression: ca.SX
    lower: ca.SX
    upper: ca.SX


class Instance(NamedTuple):
    """Numerical data of one QP: min 1/2 x'Hx + g'x, lower <= x <= upper, rows_lower <= A x <= rows_upper."""

    H: Array
    g: Array
    A: Array
    rows_lower: Array
    rows_upper: Array
    lower: Array
    upper: Array


def parameter(name: str, size: int) -> ca.SX:
    """Symbols for numbers that change from tick to tick, one column."""
    return ca.SX.sym(name, size)


def variable(name: str, size: int, *, lower: Any = -np.inf, upper: Any = np.inf) -> Variable:
    """Decision variables with bounds, each a number or an expression of the parameters."""
    ones = ca.SX.ones(size)
    return Variable(ca.SX.sym(name, size), ca.SX(lower) * ones, ca.SX(upper) * ones)


def equal(left: Any, right: Any) -> Row:
    """Rows left == right."""
    return within(left, right, right)


def within(expression: Any, lower: Any, upper: Any) -> Row:
    """Rows lower <= expression <= upper; bounds are numbers or expressions of parameters, or infinite."""
    columns = [ca.SX(each) for each in (expression, lower, upper)]
    ones = ca.SX.ones(max(column.size1() for column in columns))  # a scalar applies to every row
    return Row(*(column * ones for column in columns))


def check_that_it_is_a_qp(
    name: str, cost: ca.SX, x: ca.SX, *, rows: Row, bounds: tuple[ca.SX, ca.SX], given: Sequence[ca.SX]
) -> None:
    """Check that cost, rows and bounds over x and the given symbols form a QP; errors as in `Statement`."""
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
    """The row, rewritten so that its bounds contain no variables; only an equality may have variables there."""
    if not (ca.depends_on(row.lower, x) or ca.depends_on(row.upper, x)):
        return row
    if not ca.is_equal(row.lower, row.upper, 50):
        raise ConfigurationError("subject_to", str(row.expression)[:60], "variables in a bound only of an equality")
    zeros = ca.SX.zeros(row.expression.numel())
    return row._replace(expression=row.expression - row.lower, lower=zeros, upper=zeros)
