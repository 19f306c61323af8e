"""A QP stated once, symbolically; its numbers, its fused solve and its certificate are derived from the statement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import all_true, certificate_function, one_is_zero, violation

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["Instance", "Row", "Statement", "Variable", "equal", "parameter", "variable", "within"]

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


@dataclass(frozen=True, eq=False)
class Statement:
    """A convex QP in terms of parameters.

    Parameters
    ----------
    name : identifier, used in generated code.
    parameters : columns that are known when it is solved, in the order in which they are passed.
    variables : what is decided.
    minimise : scalar, quadratic in the variables.
    subject_to : rows linear in the variables.
    seldom : how many of the last rows are seldom active: the fused function solves without them first, and again with
        them only where the certificate, which always has all rows, says that one was missed.
    rounds : how often the fused function corrects the active set of the last tick before the solver runs.
    iterations : cap on the active-set changes of the fused solver, None for its own: what is not found soon is seldom
        found later, and the backup waits.
    requires : conditions on the parameters without which no answer is certified.
    report : column of expressions of parameters and variables, evaluated at the answer; keep it cheap.
    guess : (n,) expression of the answer when no bound is active, or None. It is certified like any other answer;
        the solver runs only where it fails.
    multipliers : (m,) expression of the rows' multipliers at the guess, or None where no row is active there.
    prepared, prepare : columns that hold what `prepare`, a function of (parameters, memory), each one column, gives
        for them: work that must not be repeated, or that expressions cannot leave out when it is not needed.
    settled, settle : columns that hold what `settle`, a function of (complete parameters, memory, x), each one column,
        gives for the answer, before report, memory and violation are made of it: work that expressions cannot leave
        out when it is not needed.
    memory : column standing for what the last certified tick left behind (its last velocity, say).
    remember : column of expressions of parameters and variables that becomes the next tick's memory.
    violation : by how much what is made of the answer in `remember` breaks the bounds, zero or more; it is added to
        the certificate's residual. NaN fails.

    Raises
    ------
    ConfigurationError : the cost is no scalar quadratic in the variables, a row is not linear in them, or a symbol in
        either is not given.
    """

    name: str
    parameters: Sequence[ca.SX]
    variables: Sequence[Variable]
    minimise: ca.SX
    subject_to: Sequence[Row] = ()
    seldom: int = 0
    rounds: int = 0
    iterations: int | None = None
    requires: Sequence[ca.SX] = ()
    report: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    guess: ca.SX | None = None
    multipliers: ca.SX | None = None
    prepared: Sequence[ca.SX] = ()
    prepare: ca.Function | None = None
    settled: Sequence[ca.SX] = ()
    settle: ca.Function | None = None
    memory: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    remember: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    violation: ca.SX = field(default_factory=lambda: ca.SX(1, 1))

    def __post_init__(self) -> None:
        """Check that it is a QP."""
        x = self._x
        if self.minimise.numel() != 1:
            raise ConfigurationError("minimise", self.minimise.shape, "a scalar cost")
        given = {symbol.element_hash() for column in (self._p, self.memory) for symbol in ca.vertsplit(column)}
        decided = {symbol.element_hash() for symbol in ca.vertsplit(x)}
        bounds = ca.vertcat(*self._bounds)
        for argument, expression, known in (
            ("variables", bounds, given),
            ("minimise", self.minimise, given | decided),
            ("subject_to", ca.vertcat(*self._rows), given | decided),
        ):
            for symbol in ca.symvar(expression):
                if symbol.element_hash() not in known:
                    raise ConfigurationError(argument, symbol.name(), "expressions of what is given before")
        if not ca.is_quadratic(self.minimise, x):
            raise ConfigurationError("minimise", self.name, "a cost quadratic in the variables")
        if not ca.is_linear(self._rows.expression, x):
            raise ConfigurationError("subject_to", self.name, "rows linear in the variables")

    @property
    def n(self) -> int:
        """Number of variables."""
        return int(self._x.numel())

    @property
    def m(self) -> int:
        """Number of rows."""
        return int(self._rows.expression.numel())

    @property
    def parameter_size(self) -> int:
        """Length of the column of all parameters."""
        return sum(int(symbol.numel()) for symbol in self.parameters)

    @property
    def state_size(self) -> int:
        """Length of what passes from tick to tick: x, the multipliers of its bounds and of the rows, the memory."""
        return 2 * self.n + self.m + int(self.memory.numel())

    @cached_property
    def build(self) -> ca.Function:
        """Complete parameters, memory -> H, g, A, rows_lower, rows_upper, lower, upper, sound."""
        x, rows = self._x, self._rows
        origin = ca.SX.zeros(self.n)
        hessian = ca.triu2symm(ca.triu(ca.hessian(self.minimise, x)[0]))  # half the entries need computing
        gradient = ca.substitute(ca.gradient(self.minimise, x), x, origin)
        matrix = ca.jacobian(rows.expression, x)
        offset = ca.substitute(rows.expression, x, origin)
        lower, upper = self._bounds
        numbers = [hessian, gradient, matrix, rows.lower - offset, rows.upper - offset, lower, upper, self._sound]
        outputs = [ca.densify(each) for each in numbers]
        return ca.Function(f"{self.name}_build", [self._p, self.memory], outputs, {"cse": True})

    @cached_property
    def screen(self) -> ca.Function:
        """Complete parameters, memory -> x, its multipliers, its residual of the guess; whether parameters are sound.

        Within its bounds and rows, a point without gradient is the answer: that is the guess's certificate, and needs
        no Hessian. So is one whose gradient the multipliers balance, or press against a bound. Outside, or where
        nothing is guessed, the residual is infinite.
        """
        nothing = ca.SX.zeros(self.n + self.m)
        if self.guess is None:
            told = [ca.vertcat(ca.SX.zeros(self.n), nothing), ca.SX(ca.inf)]
        elif self.multipliers is None:
            guess, rows = self.guess, self._rows
            slope, values = ca.substitute([ca.gradient(self.minimise, self._x), rows.expression], [self._x], [guess])
            lower, upper = self._bounds
            inside = all_true(guess >= lower, guess <= upper, values >= rows.lower, values <= rows.upper)
            # Not a quotient: of a slope that is zero by its form CasADi would drop the divisor, and with it the bounds.
            residual = ca.if_else(ca.logic_and(inside, self._sound), ca.norm_2(slope), ca.inf)
            told = [ca.vertcat(guess, nothing), residual]
        else:
            told = self._balanced_guess(self.guess, self.multipliers)
        outputs = [ca.densify(told[0]), told[1], self._sound]
        return ca.Function(f"{self.name}_screen", [self._p, self.memory], outputs, {"cse": True})

    def _balanced_guess(self, guess: ca.SX, multipliers: ca.SX) -> list[ca.SX]:
        """The guess with its multipliers, and the certificate's residual of it."""
        rows, (lower, upper) = self._rows, self._bounds
        slope, values, matrix = ca.substitute(
            [ca.gradient(self.minimise, self._x), rows.expression, ca.jacobian(rows.expression, self._x)],
            [self._x],
            [guess],
        )
        pressed = -(slope + matrix.T @ multipliers)
        at_bound = ca.logic_or(ca.logic_and(guess >= upper, pressed > 0), ca.logic_and(guess <= lower, pressed < 0))
        violated = violation(values, rows.lower, rows.upper)
        loose = one_is_zero(multipliers, values, rows.lower, rows.upper)
        squares = ca.sumsqr(ca.if_else(at_bound, 0, pressed)) + ca.sumsqr(violated) + ca.sumsqr(loose)
        # A sum that NaN poisons, where fmax and a choice would drop it.
        finite = ca.sumsqr(guess) + ca.sumsqr(pressed) + ca.sumsqr(values) <= PLAUSIBLE**2
        inside = all_true(guess >= lower, guess <= upper, finite, self._sound)
        bound_multipliers = ca.if_else(at_bound, pressed, 0)
        return [ca.vertcat(guess, bound_multipliers, multipliers), ca.if_else(inside, ca.sqrt(squares), ca.inf)]

    @cached_property
    def certify(self) -> ca.Function:
        """See `certificate_function`."""
        return certificate_function(self.n, self.m)

    @cached_property
    def finish(self) -> ca.Function:
        """Parameters, memory, x -> report, the next memory, the violation that it holds."""
        outputs = [ca.densify(each) for each in (self.report, self.remember, self.violation)]
        inputs, settled = [self._p, self.memory, self._x], ca.vertcat(ca.SX(0, 1), *self.settled)
        if self.settle is None:
            return ca.Function(f"{self.name}_finish", inputs, outputs, {"cse": True})
        last = ca.Function(f"{self.name}_settled", [*inputs, settled], outputs, {"cse": True})
        given = [ca.MX.sym("given", each.numel()) for each in inputs]
        return ca.Function(f"{self.name}_finish", given, last.call([*given, self.settle(*given)]))

    @cached_property
    def complete(self) -> ca.Function:
        """Parameters, memory -> the same parameters with the prepared ones behind, in one column."""
        p, memory = ca.MX.sym("p", self.parameter_size), ca.MX.sym("memory", self.memory.numel())
        full = p if self.prepare is None else ca.vertcat(p, self.prepare(p, memory))
        return ca.Function(f"{self.name}_complete", [p, memory], [full])

    @cached_property
    def fused(self) -> ca.Function:
        """Everything of one tick in one function: see `rehab_opt.optim.fused`."""
        from rehab_opt.optim.fused import fused  # noqa: PLC0415  (it derives from what is stated here)

        return fused(self)

    def instance(self, *parameters: ArrayLike, memory: ArrayLike = ()) -> Instance:
        """The numbers at given parameter and memory values, for inspection."""
        p = np.concatenate([np.asarray(each, dtype=np.float64).reshape(-1) for each in parameters])
        remembered = np.asarray(memory, dtype=np.float64)
        columns = [np.array(each) for each in self.build(self.complete(p, remembered), remembered)[:7]]
        return Instance(*(c if i in (0, 2) else c.reshape(-1) for i, c in enumerate(columns)))

    def to_qpsolvers(self, *parameters: ArrayLike, memory: ArrayLike = ()) -> qpsolvers.Problem:
        """The numbers at given parameter and memory values as a `qpsolvers.Problem`."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self.instance(*parameters, memory=memory))

    @cached_property
    def _bounds(self) -> tuple[ca.SX, ca.SX]:
        return ca.vertcat(*(v.lower for v in self.variables)), ca.vertcat(*(v.upper for v in self.variables))

    @cached_property
    def _sound(self) -> ca.SX:
        return all_true(ca.sumsqr(ca.vertcat(*self.parameters)) <= PLAUSIBLE**2, *self.requires)

    @cached_property
    def _x(self) -> ca.SX:
        return ca.vertcat(*(v.symbol for v in self.variables))

    @cached_property
    def _p(self) -> ca.SX:
        return ca.vertcat(*self.parameters, *self.prepared)

    @cached_property
    def _rows(self) -> Row:
        empty = Row(ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1))
        # A bound that holds variables moves to the left, so that bounds are numbers; only equal() may have one.
        rows = [_numeric_bounds(row, self._x) for row in self.subject_to]
        return Row(*(ca.vertcat(*parts) for parts in zip(empty, *rows, strict=True)))


def _numeric_bounds(row: Row, x: ca.SX) -> Row:
    if not (ca.depends_on(row.lower, x) or ca.depends_on(row.upper, x)):
        return row
    if not ca.is_equal(row.lower, row.upper, 50):
        raise ConfigurationError("subject_to", str(row.expression)[:60], "variables in a bound only of an equality")
    zeros = ca.SX.zeros(row.expression.numel())
    return Row(row.expression - row.lower, zeros, zeros)
