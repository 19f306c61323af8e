"""Any QP of one size through the way our controllers take: fused with its certificate, compiled, warm-started."""

from __future__ import annotations

import math
from collections.abc import Collection

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.sequence import QPSequence
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.backends import Answer
from rehab_opt.optim.certificate import certificate_function, is_certified
from rehab_opt.optim.fused import fused
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import Instance, variable, within
from rehab_opt.symbolic import BufferedFunction, Compile

__all__ = ["LARGEST", "Certificate", "DenseQP", "dense_statement", "fits"]

Array = NDArray[np.float64]
LARGEST = 60
"""Variables and rows together: beyond it the code of a fused QP takes minutes to compile, and 300 of each never end."""


def fits(n: int, m: int) -> bool:
    """Whether a fused function is made of QPs of that size."""
    return n + m <= LARGEST


def dense_statement(n: int, m: int, *, equalities: Collection[int] = ()) -> Statement:
    """The QP whose every number is given: n variables, m rows, of which some are stated as equalities.

    The numbers stand where a controller has its memory, one column: H by its columns, g, A by its columns, the rows'
    bounds, the variables' bounds. Parameters must be of a sensor's size, and an absent bound is infinite.

    Raises
    ------
    ConfigurationError : more variables and rows than `LARGEST`.
    """
    if not fits(n, m):
        raise ConfigurationError("variables and rows", n + m, f"at most {LARGEST} together, to be one function")
    data = ca.SX.sym("data", n * n + n + m * n + 2 * m + 2 * n)
    hessian, gradient, matrix, rows_lower, rows_upper, lower, upper = ca.vertsplit(
        data, [0, *np.cumsum([n * n, n, m * n, m, m, n, n]).tolist()]
    )
    x = variable("x", n, lower=lower, upper=upper)
    rows_lower = ca.vertcat(ca.SX(0, 1), *(rows_upper[i] if i in equalities else rows_lower[i] for i in range(m)))
    held = [ca.fabs(rows_upper[i]) < math.inf for i in equalities]  # NaN too, which its own bound would not tell
    costs = ca.vertcat(hessian, gradient, matrix)
    return Statement(
        name=f"dense_qp_{n}_{m}",
        parameters=[ca.SX.sym("unused", 1)],
        variables=[x],
        minimise=0.5 * x.symbol.T @ ca.reshape(hessian, n, n) @ x.symbol + gradient.T @ x.symbol,
        subject_to=[within(ca.reshape(matrix, m, n) @ x.symbol, rows_lower, rows_upper)] if m else [],
        requires=[ca.sumsqr(costs) < math.inf, rows_lower <= rows_upper, lower <= upper, *held],
        active_set=not m,
        memory=data,
    )


class DenseQP:
    """The fused function of `dense_statement`: by active sets where there are no rows, else by qrqp; certified.

    Parameters
    ----------
    equalities : rows whose bounds are equal in every tick, as a controller's statement knows them.
    tolerance : largest residual of an answer that the next solve starts from; after any other it starts from nothing.
    compile : see `BufferedFunction`.
    """

    def __init__(
        self,
        n: int,
        m: int,
        *,
        equalities: Collection[int] = (),
        tolerance: float = 1e-8,
        compile: Compile = None,
    ) -> None:
        self.n, self.m, self._tolerance = n, m, tolerance
        function = fused(dense_statement(n, m, equalities=equalities))
        self._fused = BufferedFunction(function, compile="wait" if compile is None else compile)
        self._state = self._fused.inputs[1]
        self._start, self._data = self._state[: 2 * n + m], self._state[2 * n + m :]

    @classmethod
    def of(cls, sequence: QPSequence, *, compile: Compile = None) -> DenseQP:
        """For the QPs of a sequence."""
        equal = (sequence.rows_lower == sequence.rows_upper).all(axis=0)
        return cls(
            sequence.n, sequence.m, equalities=np.flatnonzero(equal).tolist(), tolerance=sequence.tolerance,
            compile=compile,
        )  # fmt: skip

    def solve(self, data: Array, *, warm: bool) -> tuple[Array, float]:
        """Answer (2 n + m,) and its residual, for `flat` data; warm: from the last answer."""
        fused = self._fused
        if not warm:
            self._start[:] = 0.0
        self._data[:] = data
        answer, verdict = fused.outputs
        verdict[0] = math.nan  # a failure inside leaves the outputs as they are
        fused.evaluate()
        residual = float(verdict[0]) if verdict[1] else math.inf
        found: Array = answer[: self._start.size].copy()
        self._start[:] = found if is_certified(residual, self._tolerance) else 0.0
        return found, residual

    def warm_start(self, answer: Answer) -> None:
        """Begin the next warm solve at an answer of another solver."""
        self._start[:] = np.concatenate(answer[:3])

    def parted(self, found: Array) -> Answer:
        """An answer as other solvers give it."""
        return Answer(found[: self.n], found[self.n : 2 * self.n], found[2 * self.n :], -1)

    @staticmethod
    def flat(qp: Instance) -> Array:
        """The numbers of a QP as one column, as `dense_statement` has them."""
        return np.concatenate([np.asarray(part).reshape(-1, order="F") for part in qp])


class Certificate:
    """Residual of any claim about QPs of one size, computed by us: see `certificate_function`."""

    def __init__(self, n: int, m: int) -> None:
        self._function = BufferedFunction(certificate_function(n, m))

    def residual(self, qp: Instance, claim: Answer) -> float:
        """Residual of the claim clipped into its bounds; NaN or infinite where a number is."""
        # A claim of another shape is no answer to this QP.
        for array, value in zip(self._function.inputs, (*qp, 1.0, *claim[:3]), strict=True):
            given = np.asarray(value, dtype=np.float64)
            if given.size != array.size:
                return math.nan
            array[...] = given.reshape(array.shape)
        self._function()
        return float(self._function.outputs[1][0])
