"""A positive definite Hessian for sequential quadratic programming, exact along the active rows."""

from __future__ import annotations

import casadi as ca

from rehab_opt.optim.nlp import NLP

__all__ = ["convexified", "model"]

PENALTY = 10.0
"""Weight of the active rows' squares. Statements have Hessians and row gradients of order one, so one number serves."""
FLOOR = 1e-6
"""Least pivot, relative to the largest entry."""


def model(nlp: NLP, multipliers: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Hessian (n, n), positive definite, and gradient (n,) of the next QP's cost.

    The Hessian of the Lagrangian is indefinite at most solutions; it only has to be positive definite along the
    active rows. So PENALTY/2 |row + J dx - bound|^2 is added for every equality and for every bound with a multiplier.
    These terms vanish where the row holds in the QP's solution: its step and multipliers are those of the exact
    Hessian, and convergence stays quadratic. What is still indefinite is `convexified`.

    Parameters
    ----------
    nlp : the statement.
    multipliers : (n + m,) of bounds and rows; positive at an upper bound.
    """
    x, rows, jacobian = nlp.x, nlp.rows, nlp.jacobian
    of_bounds, of_rows = nlp.parted(multipliers)
    lagrangian = nlp.minimise + ca.dot(of_rows, rows.expression)
    hessian, _ = ca.hessian(lagrangian, x)
    active = ca.vertcat(*(_is_active(rows, of_rows, i) for i in range(nlp.m)), of_bounds != 0)
    normals = ca.vertcat(jacobian, ca.SX.eye(nlp.n))
    gap = ca.vertcat(_gap(rows.expression, rows.lower, rows.upper, of_rows), _gap(x, nlp.lower, nlp.upper, of_bounds))
    weight = PENALTY * active
    hessian += normals.T @ ca.diag(weight) @ normals
    # if_else, not a product: an infinite bound's gap is infinite, and that bound is never active.
    gradient = nlp.gradient + normals.T @ ca.if_else(active, PENALTY * gap, 0)
    return convexified(hessian), gradient


def convexified(hessian: ca.SX) -> ca.SX:
    """`hessian` plus a diagonal that makes it positive definite, zero where it safely is.

    The modified Cholesky factorisation of Gill, Murray and Wright (Practical Optimization, 1981, 4.4.2.2) without
    pivoting: straight-line code, a few hundred operations for eight variables.
    """
    n = hessian.size1()
    largest = ca.SX(1e-12)
    for i in range(n):
        for j in range(i + 1):
            largest = ca.fmax(largest, ca.fabs(hessian[i, j]))
    factor: dict[tuple[int, int], ca.SX] = {}  # L, unit lower triangular
    scaled: dict[tuple[int, int], ca.SX] = {}  # L D
    shift = []
    for j in range(n):
        for i in range(j, n):
            scaled[i, j] = hessian[i, j] - sum((scaled[i, k] * factor[j, k] for k in range(j)), ca.SX(0))
        below = ca.SX(0)
        for i in range(j + 1, n):
            below = ca.fmax(below, ca.fabs(scaled[i, j]))
        pivot = ca.fmax(ca.fmax(ca.fabs(scaled[j, j]), below**2 / largest), FLOOR * largest)
        shift.append(pivot - scaled[j, j])
        for i in range(j + 1, n):
            factor[i, j] = scaled[i, j] / pivot
    return ca.densify(hessian + ca.diag(ca.vertcat(*shift)))


def _is_active(rows: object, multipliers: ca.SX, i: int) -> ca.SX:
    lower, upper = rows.lower[i], rows.upper[i]  # type: ignore[attr-defined]
    return ca.SX(1) if ca.is_equal(lower, upper, 50) else multipliers[i] != 0


def _gap(value: ca.SX, lower: ca.SX, upper: ca.SX, multiplier: ca.SX) -> ca.SX:
    return ca.if_else(multiplier > 0, value - upper, value - lower)
