"""A QP's analytic answer, and the residual that certifies it without a solver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.certificate import all_true, one_is_zero, violation
from rehab_opt.optim.rows import MAX_MAGNITUDE

if TYPE_CHECKING:
    from rehab_opt.optim.rows import Row

__all__ = ["screened_analytic"]


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
    """The analytic answer, the multipliers of its bounds and of the rows in one column (n + n + m,); and its residual.

    A point within its bounds and rows is certified without the Hessian where its gradient is zero, or balanced by
    multipliers, or presses against a bound. Elsewhere, or where none is stated, the residual is infinite.
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
        # Not a quotient: of a slope that is zero by its form CasADi would drop the divisor, and with it the bounds.
        return ca.densify(ca.vertcat(analytic, nothing)), ca.if_else(
            ca.logic_and(inside, valid), ca.norm_2(slope), ca.inf
        )
    pressed = -(slope + matrix.T @ multipliers)
    at_bound = ca.logic_or(ca.logic_and(analytic >= upper, pressed > 0), ca.logic_and(analytic <= lower, pressed < 0))
    violated = violation(values, rows.lower, rows.upper)
    loose = one_is_zero(multipliers, values, rows.lower, rows.upper)
    squares = ca.sumsqr(ca.if_else(at_bound, 0, pressed)) + ca.sumsqr(violated) + ca.sumsqr(loose)
    # A sum that NaN poisons, where fmax and a choice would drop it.
    finite = ca.sumsqr(analytic) + ca.sumsqr(pressed) + ca.sumsqr(values) <= MAX_MAGNITUDE**2
    inside = all_true(analytic >= lower, analytic <= upper, finite, valid)
    told = ca.vertcat(analytic, ca.if_else(at_bound, pressed, 0), multipliers)
    return ca.densify(told), ca.if_else(inside, ca.sqrt(squares), ca.inf)
