"""A nonlinear program (NLP), stated once symbolically; solver functions and certificate are derived."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import Row, Variable

__all__ = ["MAX_MAGNITUDE", "NLP", "NLPAnswer", "convexified", "model"]

Array = NDArray[np.float64]

MAX_MAGNITUDE = 1e9
"""Largest magnitude of a parameter or of a number in a certified answer."""


class NLPAnswer(NamedTuple):
    """Answer of an NLP solver, with its certificate."""

    x: Array
    """(n,) inside its bounds."""
    multipliers: Array
    """(n + m,) multipliers of bounds and rows, positive at an upper bound."""
    cost: float
    residual: float
    """2-norm of stationarity, violation and complementarity; accept only 0 <= residual <= tolerance."""
    violation: float
    """2-norm of the rows' violation."""
    report: Array
    """The statement's report at x."""
    iterations: int
    """Number of iterations; -1 if the solver reports none."""
    solver: str
    certified: bool


@dataclass(frozen=True, eq=False)
class NLP:
    """Minimise f(x, p) subject to lower <= x <= upper and lower <= rows(x, p) <= upper.

    The certificate is absolute, in the statement's own units: scale rows and cost so that one tolerance suits all.

    Parameters
    ----------
    name : identifier, used in generated code.
    parameters : columns of known numbers, in the order in which they are passed.
    variables : decision variables; bounds are numbers or expressions of the parameters.
    minimise : scalar, twice differentiable.
    subject_to : rows from `equal` and `within`; bounds are numbers or expressions of the parameters.
    report : column of expressions, evaluated at the answer.

    Raises
    ------
    ConfigurationError : no variable, a cost that is not a scalar, a bound that depends on a variable.
    """

    name: str
    parameters: Sequence[ca.SX]
    variables: Sequence[Variable]
    minimise: ca.SX
    subject_to: Sequence[Row] = ()
    report: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    def __post_init__(self) -> None:
        if not self.n:
            raise ConfigurationError("variables", self.name, "at least one variable")
        if self.minimise.numel() != 1:
            raise ConfigurationError("minimise", self.minimise.shape, "a scalar")
        for bound in (self.lower, self.upper, self.rows.lower, self.rows.upper):
            if ca.depends_on(bound, self.x):
                raise ConfigurationError("subject_to", str(bound)[:60], "bounds without variables")

    @property
    def n(self) -> int:
        """Number of variables."""
        return int(self.x.numel())

    @property
    def m(self) -> int:
        """Number of rows."""
        return int(self.rows.expression.numel())

    @cached_property
    def x(self) -> ca.SX:
        """(n,) all variables."""
        return ca.vertcat(*(v.symbol for v in self.variables))

    @cached_property
    def p(self) -> ca.SX:
        """All parameters, one column."""
        return ca.vertcat(*self.parameters)

    @cached_property
    def lower(self) -> ca.SX:
        """(n,) lower bounds of the variables."""
        return ca.vertcat(*(v.lower for v in self.variables))

    @cached_property
    def upper(self) -> ca.SX:
        """(n,) upper bounds of the variables."""
        return ca.vertcat(*(v.upper for v in self.variables))

    @cached_property
    def rows(self) -> Row:
        """All rows, stacked in one `Row`."""
        empty = Row(ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1))
        return Row(*(ca.vertcat(*parts) for parts in zip(empty, *self.subject_to, strict=True)))

    @cached_property
    def jacobian(self) -> ca.SX:
        """(m, n) derivative of the rows."""
        return ca.jacobian(self.rows.expression, self.x)

    @cached_property
    def gradient(self) -> ca.SX:
        """(n,) derivative of the cost."""
        return ca.gradient(self.minimise, self.x)

    def parted(self, multipliers: Any) -> Any:
        """Split multipliers (n + m,) into two: those of the bounds (n,) and those of the rows (m,)."""
        return ca.vertsplit(multipliers, [0, self.n, self.n + self.m])

    @cached_property
    def bounds(self) -> ca.Function:
        """Function (p) -> lower and upper bounds of x (n,), and lower and upper bounds of the rows (m,)."""
        outputs = [self.lower, self.upper, self.rows.lower, self.rows.upper]
        return ca.Function(f"{self.name}_bounds", [self.p], [ca.densify(each) for each in outputs])

    @cached_property
    def certify(self) -> ca.Function:
        """Function (p, claim (n,), multipliers (n + m,)) -> x, cost, residual, violation, report.

        x is the claim clipped into its bounds; this x is certified. The residual is the 2-norm of three vectors
        together: stationarity grad f + y_x + J'y with the multipliers y_x of bounds and y of rows; violation of the
        rows; |multiplier| * min(slack, 1) of every bound. The product suits interior-point answers: at a weakly active
        bound both factors are near the square root of the tolerance. A NaN or infinite number makes the residual NaN or
        infinite.
        """
        claim, multipliers = ca.SX.sym("claim", self.n), ca.SX.sym("y", self.n + self.m)
        of_bounds, of_rows = self.parted(multipliers)
        x = clipped(claim, self.lower, self.upper)
        at = ca.Function(
            "at",
            [self.x, self.p],
            [self.rows.expression, self.gradient, self.jacobian, self.minimise, self.report],
            ["x", "p"],
            ["rows", "gradient", "jacobian", "cost", "report"],
            {"cse": True},
        )
        rows, gradient, jacobian, cost, report = at(x, self.p)
        low, high = self.rows.lower, self.rows.upper
        violation = ca.fmax(low - rows, 0) + ca.fmax(rows - high, 0)
        parts = ca.vertcat(
            gradient + of_bounds + jacobian.T @ of_rows,
            violation,
            _slackness(of_bounds, x, self.lower, self.upper),
            _slackness(of_rows, rows, low, high),
        )
        sane = all_true(
            *(ca.fabs(each) <= MAX_MAGNITUDE for each in (claim, multipliers, rows, cost, self.p)),
            self.lower <= self.upper,
            low <= high,
        )
        # Not quotients: for a structurally zero violation, without rows, CasADi would drop the divisor.
        judged = [ca.if_else(sane, ca.norm_2(each), ca.inf) for each in (parts, violation)]
        outputs = [x, cost, *judged, report]
        name = f"{self.name}_certificate"
        return ca.Function(name, [self.p, claim, multipliers], [ca.densify(o) for o in outputs], {"cse": True})


def _slackness(multiplier: ca.SX, value: ca.SX, lower: ca.SX, upper: ca.SX) -> ca.SX:
    at_upper = ca.fmax(multiplier, 0) * ca.fmin(ca.fmax(upper - value, 0), 1)
    at_lower = ca.fmax(-multiplier, 0) * ca.fmin(ca.fmax(value - lower, 0), 1)
    return ca.vertcat(at_upper, at_lower)


PENALTY = 10.0
"""Weight of the squared error of active rows, for Hessians and row gradients of order one."""
FLOOR = 1e-6
"""Smallest pivot, relative to the largest entry."""


def model(nlp: NLP, multipliers: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Two results: Hessian (n, n), positive definite, and gradient (n,) of the cost of the next QP.

    The Hessian of the Lagrangian is positive definite only along the active rows. Therefore PENALTY/2 |row + J dx -
    bound|^2 is added for every equality and every bound with a multiplier. These terms vanish if the row holds in the
    QP's solution, so convergence stays quadratic. A Hessian that is still indefinite is `convexified`. `multipliers` (n
    + m,) of bounds and rows are positive at an upper bound.
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
    # if_else, not a product: the gap of an infinite bound is infinite, and that bound is never active.
    gradient = nlp.gradient + normals.T @ ca.if_else(active, PENALTY * gap, 0)
    return convexified(hessian), gradient


def convexified(hessian: ca.SX) -> ca.SX:
    """`hessian`, made positive definite by a diagonal, which is zero if `hessian` is safely positive definite.

    The modified Cholesky factorisation of Gill, Murray and Wright (Practical Optimization, 1981, 4.4.2.2) without
    pivoting.
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


def _is_active(rows: Row, multipliers: ca.SX, i: int) -> ca.SX:
    return ca.SX(1) if ca.is_equal(rows.lower[i], rows.upper[i], 50) else multipliers[i] != 0


def _gap(value: ca.SX, lower: ca.SX, upper: ca.SX, multiplier: ca.SX) -> ca.SX:
    return ca.if_else(multiplier > 0, value - upper, value - lower)
