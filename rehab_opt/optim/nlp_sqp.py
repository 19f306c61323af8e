"""Sequential quadratic programming; one compiled function does an iteration (derivatives, QP, certificate)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.nlp import NLP, NLPAnswer, model
from rehab_opt.optim.qrqp import qrqp
from rehab_opt.optim.recorder import recorder_now
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import BufferedFunction, Compile

__all__ = ["SQP"]

Array = NDArray[np.float64]

QP_ITERATIONS = 30
"""Cap on the active-set changes of one QP; an infeasible QP would continue for milliseconds."""
QP_VIOLATION = 1e-8
"""If the answer to a QP violates a row by more, the QP has no solution within the bounds and the radius."""


class SQP:
    """SQP with full steps, for a start near the solution: quadratic convergence, 10-30 us an iteration when compiled.

    There is no line search. An answer that has not converged within the cap fails its certificate: try another start.
    One thread at a time.

    Parameters
    ----------
    tolerance : largest accepted residual. max_iterations : cap on iterations. compile : see `BufferedFunction`.
    radius : largest change of a variable in one iteration, in the variables' units.
    """

    name = "sqp"

    def __init__(
        self,
        nlp: NLP,
        *,
        tolerance: float = 1e-9,
        max_iterations: int = 25,
        radius: float = 1.0,
        compile: Compile = None,
    ) -> None:
        if not 0 < tolerance < 1:
            raise ConfigurationError("tolerance", tolerance, "a number above 0 and below 1")
        if max_iterations < 0:
            raise ConfigurationError("max_iterations", max_iterations, "zero or more")
        if not radius > 0:
            raise ConfigurationError("radius", radius, "a positive number")
        self.nlp, self.tolerance, self.max_iterations = nlp, float(tolerance), int(max_iterations)
        self._step = BufferedFunction(step_function(nlp), compile=compile)
        self.parameters, self._x, self._multipliers, self._radius = self._step.inputs
        self._radius[:] = radius
        self._next_x, self._next_multipliers, cost, residual, violation, self._report = self._step.outputs
        # A memoryview yields Python floats twice as fast as an array.
        self._cost, self._residual, self._violation = (_numbers(each) for each in (cost, residual, violation))
        self._iterate = self._watched_step()

    def solve(self, start: ArrayLike, multipliers: ArrayLike = 0.0, *, max_iterations: int | None = None) -> NLPAnswer:
        """Solve from `start` (n,) and earlier `multipliers` (n + m,); the caller first fills `parameters`."""
        self._x[:] = start
        self._multipliers[:] = multipliers
        cap = self.max_iterations if max_iterations is None else max_iterations
        residual, iterations, certified = np.inf, 0, False
        while iterations < cap and not certified:
            # A failed QP ends compiled code before it writes, so the last certificate is cleared first.
            self._residual[0] = math.nan
            self._iterate()
            iterations += 1
            residual = self._residual[0]
            if not residual < np.inf:  # NaN or infinite: the next step would fail, too
                break
            certified = 0.0 <= residual <= self.tolerance
            self._x[:] = self._next_x
            self._multipliers[:] = self._next_multipliers
        violation = self._violation[0] if residual < np.inf else residual
        return NLPAnswer(
            self._x.copy(), self._multipliers.copy(), self._cost[0], residual, violation,
            self._report.copy(), iterations, self.name, certified,
        )  # fmt: skip

    def _watched_step(self) -> Callable[[], None]:
        """The step function; if a recorder is active now, each of its QPs is recorded."""
        recorder = recorder_now()
        if recorder is None:
            return self._step
        subproblem = subproblem_function(self.nlp)

        def instance(*values: Array) -> Instance:
            columns = [each.full() for each in subproblem(*values)]
            return Instance(*(c if i in (0, 2) else c.reshape(-1) for i, c in enumerate(columns)))

        stream = recorder.stream(f"{self.nlp.name}_step", self.tolerance, instance, ticks=False)
        return recorder.watched(self._step, stream, lambda: tuple(self._step.inputs))


def _numbers(array: Array) -> memoryview[float]:
    return memoryview(array)  # type: ignore[arg-type]


def step_function(nlp: NLP) -> ca.Function:
    """Function (p, x (n,), multipliers (n + m,), radius) -> next x, multipliers, cost, residual, violation, report."""
    n, m = nlp.n, nlp.m
    p, start, y, radius = inputs = _step_inputs(nlp)
    x = _inside(nlp)(p, start)
    of_bounds, of_rows = nlp.parted(y)
    h, g, a, rows_lower, rows_upper, lower, upper = _derivatives(nlp)(p, x, y)
    solution = qrqp(f"{nlp.name}_qp", n, m, iterations=QP_ITERATIONS)(
        h=h, g=g, a=a, lba=rows_lower, uba=rows_upper,
        lbx=ca.fmax(lower, -radius), ubx=ca.fmin(upper, radius), lam_x0=of_bounds, lam_a0=of_rows,
    )  # fmt: skip
    multipliers = ca.vertcat(solution["lam_x"], solution["lam_a"])
    next_x, cost, residual, violation, report = nlp.certify(p, x + solution["x"], multipliers)
    # As in compiled code, a QP without a solution gives no step.
    residual = residual / _holds(n, m)(solution["x"], a, rows_lower, rows_upper)
    outputs: list[Any] = [next_x, multipliers, cost, residual, violation, report]
    return ca.Function(f"{nlp.name}_step", inputs, outputs)


def subproblem_function(nlp: NLP) -> ca.Function:
    """Function (inputs of `step_function`) -> data of the QP that this step solves, in the order of `Instance`."""
    p, start, y, radius = inputs = _step_inputs(nlp)
    *others, lower, upper = _derivatives(nlp)(p, _inside(nlp)(p, start), y)
    outputs = [*others, ca.fmax(lower, -radius), ca.fmin(upper, radius)]
    return ca.Function(f"{nlp.name}_subproblem", inputs, outputs)


def _step_inputs(nlp: NLP) -> list[Any]:
    sizes = {"p": nlp.p.numel(), "x": nlp.n, "y": nlp.n + nlp.m, "radius": 1}
    return [ca.MX.sym(name, size) for name, size in sizes.items()]


def _inside(nlp: NLP) -> ca.Function:
    return ca.Function("inside", [nlp.p, nlp.x], [clipped(nlp.x, nlp.lower, nlp.upper)])


def _derivatives(nlp: NLP) -> ca.Function:
    """Function (p, x, multipliers) -> H, g, A, and the lower and upper bounds minus the rows and minus x."""
    symbols = ca.SX.sym("y", nlp.n + nlp.m)
    hessian, gradient = model(nlp, symbols)
    rows = nlp.rows
    return ca.Function(
        f"{nlp.name}_model",
        [nlp.p, nlp.x, symbols],
        [ca.densify(each) for each in (
            hessian, gradient, nlp.jacobian, rows.lower - rows.expression, rows.upper - rows.expression,
            nlp.lower - nlp.x, nlp.upper - nlp.x,
        )],
        {"cse": True},
    )  # fmt: skip


def _holds(n: int, m: int) -> ca.Function:
    """Function (x, A, lower, upper) -> 1 if lower <= A x <= upper, apart from `QP_VIOLATION`, else 0."""
    x, matrix, lower, upper = ca.SX.sym("x", n), ca.SX.sym("A", m, n), ca.SX.sym("lower", m), ca.SX.sym("upper", m)
    rows = matrix @ x
    held = all_true(rows >= lower - QP_VIOLATION, rows <= upper + QP_VIOLATION)
    return ca.Function("holds", [x, matrix, lower, upper], [held])
