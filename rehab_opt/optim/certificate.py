"""Residuals of a solution that a QP solver claims, computed independently of the solver."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import casadi as ca

from rehab_opt.optim.rows import MAX_MAGNITUDE, Row

__all__ = [
    "all_true",
    "certificate_function",
    "certified_expressions",
    "clipped",
    "delivered_fraction",
    "first_true",
    "is_certified",
    "one_is_zero",
    "screened_analytic",
    "violation",
]


def certificate_function(n: int, m: int) -> ca.Function:
    """Certificate of x for  min 1/2 x'Hx + g'x,  lower <= x <= upper,  rows_lower <= A x <= rows_upper.

    Inputs: H (n, n), g (n,), A (m, n), rows_lower, rows_upper (m,), lower, upper (n,), valid (1 if the data are valid,
    else 0), x (n,), and the multipliers of bounds (n,) and rows (m,), positive at an upper bound.

    Outputs: x clipped into its bounds (this x is certified and used), and the residual. The residual is the 2-norm of
    three vectors together: stationarity H x + g + y_x + A'y_A with the multipliers y_x of bounds and y_A of rows;
    violation of the rows; min(multiplier, slack) of every bound. The residual has the units of the statement. Any NaN
    makes it infinite or NaN, although CasADi's fmax and fmin drop NaN. Accept with `is_certified`.
    """
    hessian, gradient, matrix = ca.SX.sym("H", n, n), ca.SX.sym("g", n), ca.SX.sym("A", m, n)
    rows_lower, rows_upper = ca.SX.sym("rows_lower", m), ca.SX.sym("rows_upper", m)
    lower, upper, valid = ca.SX.sym("lower", n), ca.SX.sym("upper", n), ca.SX.sym("valid")
    claim, bound_multiplier, row_multiplier = ca.SX.sym("x", n), ca.SX.sym("y_x", n), ca.SX.sym("y_A", m)

    data = [hessian, gradient, matrix, rows_lower, rows_upper, lower, upper, valid]
    outputs = certified_expressions(data, claim, bound_multiplier, row_multiplier)
    return ca.Function("certificate", [*data, claim, bound_multiplier, row_multiplier], outputs)


def certified_expressions(
    data: Sequence[ca.SX], claim: ca.SX, bound_multiplier: ca.SX, row_multiplier: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Expressions of `certificate_function`; structural zeros and infinite bounds cost nothing."""
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper, valid = data
    x = clipped(claim, lower, upper)
    rows = matrix @ x
    stationarity = hessian @ x + gradient + bound_multiplier + matrix.T @ row_multiplier
    complementarity = ca.vertcat(
        one_is_zero(bound_multiplier, x, lower, upper), one_is_zero(row_multiplier, rows, rows_lower, rows_upper)
    )
    outside = violation(rows, rows_lower, rows_upper)
    residual = ca.sqrt(ca.sumsqr(stationarity) + ca.sumsqr(outside) + ca.sumsqr(complementarity))
    sane = all_true(
        valid > 0, ca.fabs(claim) <= 1e30, x <= upper, x >= lower, ca.fabs(rows) <= 1e30, rows_lower <= rows_upper
    )
    return x, residual / sane


def violation(values: ca.SX, lower: ca.SX, upper: ca.SX) -> ca.SX:
    """Violation of each bound, zero if satisfied; constant infinite bounds are left out."""
    low, high = _not(lower, -ca.inf), _not(upper, ca.inf)
    return ca.vertcat(ca.fmax(lower[low] - values[low], 0), ca.fmax(values[high] - upper[high], 0))


def _not(column: ca.SX, number: float) -> list[int]:
    """Indices of the elements that differ from the constant `number`."""
    elements = ca.vertsplit(column) if column.numel() else []
    return [i for i, each in enumerate(elements) if not (each.is_constant() and float(each) == number)]


def all_true(*conditions: ca.SX) -> ca.SX:
    """1 if every element of every condition holds, else 0; comparisons with NaN do not hold."""
    elements = [each for condition in conditions if condition.numel() for each in ca.vertsplit(ca.vec(condition))]
    return reduce(ca.logic_and, elements, ca.SX(1))


def first_true(conditions: ca.SX) -> ca.SX:
    """Column with 1 at the first condition that holds, else 0."""
    column, found = ca.SX.zeros(conditions.numel()), ca.SX(0)
    for i in range(conditions.numel()):
        column[i] = ca.logic_and(conditions[i], ca.logic_not(found))
        found = ca.logic_or(found, conditions[i])
    return column


def is_certified(residual: float, tolerance: float) -> bool:
    """Whether 0 <= residual <= tolerance; false for NaN."""
    return 0.0 <= residual <= tolerance


def clipped(value: Any, lower: Any, upper: Any) -> ca.SX:
    """Expression of `value` clipped to [lower, upper]; NaN becomes a bound, so NaN must be checked elsewhere."""
    inside: ca.SX = ca.fmin(ca.fmax(value, lower), upper)
    return inside


NEGLIGIBLE = 1e-3
"""Delivered fraction of the task below which the command is `BLOCKED`."""


def delivered_fraction(
    given: ca.SX, desired: ca.SX, missed: ca.SX, *, least: float, enough: ca.SX | float = NEGLIGIBLE
) -> ca.SX:
    """Fraction of the motion `desired` that the motion `given` delivers.

    A fraction up to `enough` counts as 0. The result is 1 if the condition `missed` is false, or if no more than
    `least` is desired.
    """
    size = ca.sumsqr(desired)
    along = clipped(ca.dot(given, desired) / ca.fmax(size, least**2), 0, 1)
    return ca.if_else(ca.logic_and(missed, size > least**2), ca.if_else(along > enough, along, 0), 1)


def one_is_zero(multiplier: ca.SX, value: ca.SX, lower: ca.SX, upper: ca.SX) -> ca.SX:
    """min(multiplier, slack) at bounds, also infinite ones: exactly zero if the multiplier or the slack is zero."""
    told = _not(multiplier, 0.0)
    pushing, at, low, high = multiplier[told], value[told], lower[told], upper[told]
    at_upper = ca.fmin(ca.fmax(pushing, 0), ca.fmax(high - at, 0))
    return ca.vertcat(at_upper, ca.fmin(ca.fmax(-pushing, 0), ca.fmax(at - low, 0)))


def screened_analytic(
    analytic: ca.SX | None,
    multipliers: ca.SX | None,
    *,
    cost: ca.SX,
    x: ca.SX,
    rows: Row,
    bounds: tuple[ca.SX, ca.SX],
    valid: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """Two results: the analytic answer with its multipliers of bounds and rows, a column (n + n + m,); its residual.

    The residual needs no Hessian: it is zero at a point within bounds and rows where multipliers or active bounds
    balance the gradient. Outside the bounds, or without an analytic answer, the residual is infinite.
    """
    nothing = ca.SX.zeros(x.numel() + rows.expression.numel())
    if analytic is None:
        return ca.densify(ca.vertcat(ca.SX.zeros(x.numel()), nothing)), ca.SX(ca.inf)
    lower, upper = bounds
    slope, values, matrix = ca.substitute(
        [ca.gradient(cost, x), rows.expression, ca.jacobian(rows.expression, x)], [x], [analytic]
    )
    if multipliers is None:
        inside = all_true(analytic >= lower, analytic <= upper, values >= rows.lower, values <= rows.upper)
        # Not a quotient: for a structurally zero slope CasADi would drop the divisor, and with it the bounds.
        return ca.densify(ca.vertcat(analytic, nothing)), ca.if_else(
            ca.logic_and(inside, valid), ca.norm_2(slope), ca.inf
        )
    pressed = -(slope + matrix.T @ multipliers)
    at_bound = ca.logic_or(ca.logic_and(analytic >= upper, pressed > 0), ca.logic_and(analytic <= lower, pressed < 0))
    violated = violation(values, rows.lower, rows.upper)
    loose = one_is_zero(multipliers, values, rows.lower, rows.upper)
    squares = ca.sumsqr(ca.if_else(at_bound, 0, pressed)) + ca.sumsqr(violated) + ca.sumsqr(loose)
    # A sum, since NaN survives in it; fmax and if_else would drop NaN.
    finite = ca.sumsqr(analytic) + ca.sumsqr(pressed) + ca.sumsqr(values) <= MAX_MAGNITUDE**2
    inside = all_true(analytic >= lower, analytic <= upper, finite, valid)
    told = ca.vertcat(analytic, ca.if_else(at_bound, pressed, 0), multipliers)
    return ca.densify(told), ca.if_else(inside, ca.sqrt(squares), ca.inf)
