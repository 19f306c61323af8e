"""A guess of a QP's answer, and the residual that certifies it without a solver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from rehab_opt.optim.certificate import all_true, one_is_zero, violation
from rehab_opt.optim.rows import PLAUSIBLE

if TYPE_CHECKING:
    from rehab_opt.optim.rows import Row

__all__ = ["screened_guess"]


def screened_guess(
    guess: ca.SX | None,
    multipliers: ca.SX | None,
    *,
    cost: ca.SX,
    x: ca.SX,
    rows: Row,
    bounds: tuple[ca.SX, ca.SX],
    sound: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """The guess, the multipliers of its bounds and of the rows in one column (n + n + m,); and its residual.

    Within its bounds and rows, a point without gradient is the answer: that is the guess's certificate, and needs no
    Hessian. So is one whose gradient the multipliers balance, or press against a bound. Outside, or where nothing is
    guessed, the residual is infinite.
    """
    nothing = ca.SX.zeros(x.numel() + rows.expression.numel())
    if guess is None:
        return ca.densify(ca.vertcat(ca.SX.zeros(x.numel()), nothing)), ca.SX(ca.inf)
    lower, upper = bounds
    slope, values, matrix = ca.substitute(
        [ca.gradient(cost, x), rows.expression, ca.jacobian(rows.expression, x)], [x], [guess]
    )
    if multipliers is None:
        inside = all_true(guess >= lower, guess <= upper, values >= rows.lower, values <= rows.upper)
        # Not a quotient: of a slope that is zero by its form CasADi would drop the divisor, and with it the bounds.
        return ca.densify(ca.vertcat(guess, nothing)), ca.if_else(ca.logic_and(inside, sound), ca.norm_2(slope), ca.inf)
    pressed = -(slope + matrix.T @ multipliers)
    at_bound = ca.logic_or(ca.logic_and(guess >= upper, pressed > 0), ca.logic_and(guess <= lower, pressed < 0))
    violated = violation(values, rows.lower, rows.upper)
    loose = one_is_zero(multipliers, values, rows.lower, rows.upper)
    squares = ca.sumsqr(ca.if_else(at_bound, 0, pressed)) + ca.sumsqr(violated) + ca.sumsqr(loose)
    # A sum that NaN poisons, where fmax and a choice would drop it.
    finite = ca.sumsqr(guess) + ca.sumsqr(pressed) + ca.sumsqr(values) <= PLAUSIBLE**2
    inside = all_true(guess >= lower, guess <= upper, finite, sound)
    told = ca.vertcat(guess, ca.if_else(at_bound, pressed, 0), multipliers)
    return ca.densify(told), ca.if_else(inside, ca.sqrt(squares), ca.inf)
