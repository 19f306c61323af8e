"""What a QP is stated with: variables and rows as expressions, and one QP as numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

__all__ = ["PLAUSIBLE", "Instance", "Row", "Variable", "equal", "parameter", "variable", "within"]

Array = NDArray[np.float64]

PLAUSIBLE = 1e6
"""Parameters beyond this size, in SI units, are a broken sensor or a broken caller, not a robot."""


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
    """Numbers of one QP: min 1/2 x'Hx + g'x, lower <= x <= upper, rows_lower <= A x <= rows_upper."""

    H: Array
    g: Array
    A: Array
    rows_lower: Array
    rows_upper: Array
    lower: Array
    upper: Array


def parameter(name: str, size: int) -> ca.SX:
    """A column of numbers that change from tick to tick."""
    return ca.SX.sym(name, size)


def variable(name: str, size: int, *, lower: Any = -np.inf, upper: Any = np.inf) -> Variable:
    """Decision variables with bounds, each a number or an expression of the parameters."""
    ones = ca.SX.ones(size)
    return Variable(ca.SX.sym(name, size), ca.SX(lower) * ones, ca.SX(upper) * ones)


def equal(left: Any, right: Any) -> Row:
    """The rows left == right."""
    return within(left, right, right)


def within(expression: Any, lower: Any, upper: Any) -> Row:
    """The rows lower <= expression <= upper; bounds are numbers or expressions of parameters, or infinite."""
    columns = [ca.SX(each) for each in (expression, lower, upper)]
    ones = ca.SX.ones(max(column.size1() for column in columns))  # a scalar stands for every row
    return Row(*(column * ones for column in columns))
