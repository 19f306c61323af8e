"""A QP, stated once symbolically; its numerical data and its certificate are derived."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.optim.certificate import all_true, certificate_function, screened_analytic
from rehab_opt.optim.rows import MAX_MAGNITUDE, Instance, Row, Variable, check_that_it_is_a_qp, with_numeric_bounds
from rehab_opt.symbolic.shared import remembered
from rehab_opt.symbolic.tick import Stages

__all__ = ["Form", "Statement"]


class Form(NamedTuple):
    """Structure of a `Statement`, from which its solvers are made. The QP's data are one column without duplicates."""

    n: int
    m: int
    active_set: bool
    """See `Statement`."""
    build: ca.Function
    """Function: data column -> H, g, A, rows_lower, rows_upper, lower, upper, with all constants filled in."""
    certify: ca.Function

    def symbols(self) -> tuple[ca.SX, list[ca.SX]]:
        """Two results: a column of symbols for the QP data, and the outputs of `build` for it."""
        numbers = ca.SX.sym("numbers", self.build.numel_in(0))
        return numbers, self.build.call([numbers])

    def rows(self) -> tuple[list[int], list[int]]:
        """Two lists of row indices: the equalities, whose bounds are the same expression, and the other rows."""
        low, high = self.symbols()[1][3:5]
        equal = [i for i in range(self.m) if ca.is_equal(low[i], high[i], 10)]
        return equal, [i for i in range(self.m) if i not in equal]


@dataclass(frozen=True, eq=False)
class Statement:
    """A convex QP in terms of parameters.

    Parameters
    ----------
    name : identifier, used in generated code.
    parameters : columns of known numbers, in the order in which they are passed.
    variables : decision variables.
    minimise : scalar, quadratic in the variables.
    subject_to : rows linear in the variables.
    active_set : whether the fused function tries the last tick's active set and the dual active set method before qrqp.
        The cost must then be strictly convex and the equalities independent.
    requires : conditions on the parameters without which no answer is certified.
    report : column of expressions of parameters and variables, evaluated at the answer.
    analytic : (n,) expression of the answer when no bound is active, or None. The solver runs only if the certificate
        of this answer fails.
    dual : (m,) expression of the rows' multipliers at the analytic answer, or None if no row is active there.
    tick : the marks in these expressions. Parts that do not depend on the variables are evaluated once, before the QP.
    memory : column of symbols for results of the last certified tick, such as its velocity.
    remember : column of expressions of parameters and variables that becomes the next tick's memory.
    violation : largest violation of the bounds by the command in `remember`, not negative. The violation is added to
        the certificate's residual; NaN fails.

    Raises
    ------
    ConfigurationError : the cost is no scalar quadratic in the variables, a row is not linear in them, or a symbol is
        neither parameter nor variable.
    """

    name: str
    parameters: Sequence[ca.SX]
    variables: Sequence[Variable]
    minimise: ca.SX
    subject_to: Sequence[Row] = ()
    active_set: bool = False
    requires: Sequence[ca.SX] = ()
    report: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    analytic: ca.SX | None = None
    dual: ca.SX | None = None
    tick: Stages = field(default_factory=Stages)
    memory: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    remember: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    violation: ca.SX = field(default_factory=lambda: ca.SX(1, 1))

    def __post_init__(self) -> None:
        given = [self._p, self.memory]
        check_that_it_is_a_qp(self.name, self.minimise, self._x, rows=self._rows, bounds=self._bounds, given=given)

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
        """Length of the state between ticks: x, the multipliers of bounds and rows, the memory."""
        return 2 * self.n + self.m + int(self.memory.numel())

    @cached_property
    def build(self) -> ca.Function:
        """Function (complete parameters, memory) -> H, g, A, rows_lower, rows_upper, lower, upper, validity (0, 1)."""
        x, rows = self._x, self._rows
        origin = ca.SX.zeros(self.n)
        hessian = ca.triu2symm(ca.triu(ca.hessian(self.minimise, x)[0]))  # half the entries need computing
        gradient = ca.substitute(ca.gradient(self.minimise, x), x, origin)
        matrix = ca.jacobian(rows.expression, x)
        offset = ca.substitute(rows.expression, x, origin)
        lower, upper = self._bounds
        numbers = [hessian, gradient, matrix, rows.lower - offset, rows.upper - offset, lower, upper, self._valid]
        outputs = [ca.densify(each) for each in numbers]
        return ca.Function(f"{self.name}_build", [self._p, self.memory], outputs, {"cse": True})

    def form(self) -> tuple[Form, ca.Function]:
        """Two results: structure of the QP, and the function (complete parameters, memory) -> its data column."""
        full, memory = ca.SX.sym("full", self.build.sparsity_in(0)), ca.SX.sym("memory", self.memory.numel())
        *data, _ = self.build.call([full, memory])
        entries = ca.vertsplit(ca.veccat(*data))
        kept = [0 if each.is_constant() else each.element_hash() for each in entries]
        numbers = {key: each for key, each in zip(kept, entries, strict=True) if key}
        column = ca.SX.sym("numbers", len(numbers))
        symbols = dict(zip(numbers, ca.vertsplit(column) if numbers else [], strict=True))
        whole = ca.vertcat(*(symbols.get(key, each) for key, each in zip(kept, entries, strict=True)))
        ends = [0, *accumulate(each.numel() for each in data)]
        parts = [ca.reshape(part, *each.shape) for part, each in zip(ca.vertsplit(whole, ends), data, strict=True)]
        build = ca.Function("build", [column], [ca.densify(each) for each in parts])
        outputs = [ca.densify(ca.vertcat(ca.SX(0, 1), *numbers.values()))]
        form = Form(self.n, self.m, self.active_set, build, self.certify)
        return form, ca.Function(f"{self.name}_numbers", [full, memory], outputs)

    @cached_property
    def screen(self) -> ca.Function:
        """Function (complete parameters, memory) -> outputs of `screened_analytic`, validity (1 or 0)."""
        told, residual = screened_analytic(
            self.analytic, self.dual,
            cost=self.minimise, x=self._x, rows=self._rows, bounds=self._bounds, valid=self._valid,
        )  # fmt: skip
        return ca.Function(f"{self.name}_screen", [self._p, self.memory], [told, residual, self._valid])

    @cached_property
    def certify(self) -> ca.Function:
        """Certificate of the QP, see `certificate_function`."""
        return remembered(("certificate", self.n, self.m), lambda: certificate_function(self.n, self.m))

    @cached_property
    def finish(self) -> ca.Function:
        """Function (parameters, memory, x) -> report, next memory, violation."""
        outputs = [self.report, self.remember, self.violation]
        return self.tick.function(f"{self.name}_finish", [self._p, self.memory, self._x], outputs)

    def finish_at(self, answer: ca.SX) -> ca.Function:
        """Function (parameters, memory) -> outputs of `finish` at `answer`, an expression of complete parameters."""
        p, memory = ca.MX.sym("p", self.parameter_size), ca.MX.sym("memory", self.memory.numel())
        full, x = self.complete(p, memory), ca.Function("answer", [self._p, self.memory], [ca.densify(answer)])
        return ca.Function(f"{self.name}_finish_at", [p, memory], self.finish.call([full, memory, x(full, memory)]))

    @cached_property
    def complete(self) -> ca.Function:
        """Function (parameters, memory) -> complete parameters: parameters, then precomputed values, one column."""
        p, memory = ca.MX.sym("p", self.parameter_size), ca.MX.sym("memory", self.memory.numel())
        column, precompute = self._precomputed
        full = ca.vertcat(p, precompute(p, memory)) if column.numel() else p
        return ca.Function(f"{self.name}_complete", [p, memory], [full])

    def instance(self, *parameters: ArrayLike, memory: ArrayLike = ()) -> Instance:
        """Data of the QP as numbers, for the given parameters and memory."""
        p = np.concatenate([np.asarray(each, dtype=np.float64).reshape(-1) for each in parameters])
        remembered = np.asarray(memory, dtype=np.float64)
        columns = [np.array(each) for each in self.build(self.complete(p, remembered), remembered)[:7]]
        return Instance(*(c if i in (0, 2) else c.reshape(-1) for i, c in enumerate(columns)))

    @cached_property
    def _bounds(self) -> tuple[ca.SX, ca.SX]:
        return ca.vertcat(*(v.lower for v in self.variables)), ca.vertcat(*(v.upper for v in self.variables))

    @cached_property
    def _valid(self) -> ca.SX:
        return all_true(ca.sumsqr(ca.vertcat(*self.parameters)) <= MAX_MAGNITUDE**2, *self.requires)

    @cached_property
    def _x(self) -> ca.SX:
        return ca.vertcat(*(v.symbol for v in self.variables))

    @cached_property
    def _p(self) -> ca.SX:
        return ca.vertcat(*self.parameters, self._precomputed[0])

    @cached_property
    def _precomputed(self) -> tuple[ca.SX, ca.Function]:
        """Two results: the column of marked symbols, and a function (parameters, memory) -> their values."""
        expressions = [
            self.minimise, *self._rows, *self._bounds, *self.requires, self.report, self.remember, self.violation,
            *(each for each in (self.analytic, self.dual) if each is not None),
        ]  # fmt: skip
        return self.tick.precomputed([ca.vertcat(*self.parameters), self.memory], expressions, later=self._x)

    @cached_property
    def _rows(self) -> Row:
        empty = Row(ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1))
        # A bound with variables (only in `equal`) moves to the left, so that bounds are numbers.
        rows = [with_numeric_bounds(row, self._x) for row in self.subject_to]
        return Row(*(ca.vertcat(*parts) for parts in zip(empty, *rows, strict=True)))
