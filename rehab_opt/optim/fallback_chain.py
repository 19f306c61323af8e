"""Primary solver, then a backup of another kind; only certified answers are returned."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import is_certified
from rehab_opt.optim.fused import FUSED_SOLVERS, fused
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.recorder import recorder_now
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import BufferedFunction, Compile

if TYPE_CHECKING:
    from rehab_opt.optim.backends import Backend

__all__ = ["BACKUP", "FUSED", "FallbackChain", "as_in_c"]

FUSED = FUSED_SOLVERS[0]
"""Name of the solver inside the fused function."""
BACKUP = "daqp"
"""Default backup; it solves every feasible QP of `bench/solvers/qp`."""


class FallbackChain:
    """Solver of one `Statement`, with a backup; call it once a tick.

    Write into `parameters`, call, and read `x`, `residual` and `report`; the next call overwrites these arrays. The
    call returns the name of the solver whose answer is certified, or "". Only a certified answer changes the memory and
    the warm start in `state`; a warm start that failed is discarded. The residual is NaN before each evaluation.

    Parameters
    ----------
    statement : the QP.
    solver, backup : "qrqp" (fused), "proxqp", "osqp", "daqp", or any solver known to qpsolvers. Backup None means daqp,
        or qrqp if `solver` is daqp.
    tolerance : largest accepted residual, in the statement's units.
    compile : see `BufferedFunction`.
    tick : function that contains the solver, in place of `fused`. Its first inputs and outputs are those of `fused`,
        and its state may be longer; the caller writes the other inputs.
    """

    def __init__(
        self,
        statement: Statement,
        *,
        solver: str,
        backup: str | None,
        tolerance: float,
        compile: Compile = None,
        tick: ca.Function | None = None,
    ) -> None:
        if not (isinstance(tolerance, float) and 0 < tolerance < 1):
            raise ConfigurationError("tolerance", tolerance, "a number above 0 and below 1")
        if backup is None:
            backup = BACKUP if solver != BACKUP else FUSED
        self.statement, self.solver, self.backup, self.tolerance = statement, solver, backup, tolerance
        self.function = function = BufferedFunction(tick or fused(statement), compile=compile)
        """The whole tick; compiled code may replace the virtual machine between two ticks."""
        self.parameters, self.everything = function.inputs[:2]
        after, self._verdict = function.outputs[:2]
        self.state, self._answer = (each[: statement.state_size] for each in (self.everything, after))
        self.residual, self.valid, self.report = self._verdict[:1], self._verdict[1:2], self._verdict[3:]
        # Memory views: twice as fast as numpy's indexing.
        self.verdict = cast("memoryview[float]", self._verdict.data)
        self.answer, self.keep = self._answer.data, self.state.data
        self.x = self._answer[: statement.n]
        self.memory = self.state[2 * statement.n + statement.m :]
        self.iterations = -1
        self._set_recorder()
        self._backends = {FUSED: None, solver: self._backend("solver", solver), backup: self._backend("backup", backup)}
        # Make the parts now, since a first failure in the loop must not wait for a compiler. Compile them only
        # if they serve the primary solver.
        parts = (statement.complete, statement.build, statement.certify, statement.finish)
        wanted: Compile = compile if solver != FUSED else False
        self._complete, self._build, self._certify, self._finish = (
            BufferedFunction(part, compile=wanted) for part in parts
        )

    def __call__(self) -> str:
        """Solve at `parameters`, warm-started; return the name of the certified solver, or ""."""
        if self.solver != FUSED:
            self._record()
            return self.solver if self._solve_by(self.solver) else self.solve_with_fallback()
        self.verdict[0] = math.nan
        self.function.evaluate()
        if 0.0 <= self.verdict[0] <= self.tolerance:
            self.keep[:] = self.answer
            return FUSED_SOLVERS[int(self.verdict[2])]
        return self.solve_with_fallback()

    def solve_with_fallback(self) -> str:
        """Try the other solvers after the primary one failed; return the name of the certified one, or ""."""
        if not (self.valid[0] or math.isnan(self.verdict[0])):  # NaN: nothing was written
            return ""  # the parameters themselves are invalid
        self.warm_start(0.0)
        self._same_problem = True
        try:
            return self._solved_by_others()
        finally:
            self._same_problem = False

    def _solved_by_others(self) -> str:
        if self.backup != self.solver and self._solve_by(self.backup):
            return self.backup
        # The last tick's active set can mislead qrqp where a cold start succeeds. A failure of qrqp takes up to
        # 1.5 ms, so the faster backup goes first.
        if self.solver == FUSED and self._solve_by(FUSED):
            return FUSED
        return ""

    @staticmethod
    def is_recorded() -> bool:
        """Whether a solver that is made now is recorded."""
        return recorder_now() is not None

    def forget(self, x: ArrayLike = 0.0) -> None:
        """Reset the warm start and the solvers, so that equal inputs give equal answers (proxqp: to rounding)."""
        self.warm_start(x)
        for solver in self._backends.values():
            if solver is not None:
                solver.forget()

    def warm_start(self, x: ArrayLike) -> None:
        """Start the next solve at x, (n,) or a scalar, with no bound active; the memory is unchanged."""
        n = self.statement.n
        self.state[n : 2 * n + self.statement.m] = 0.0
        self.state[:n] = x

    def _set_recorder(self) -> None:
        """Send each tick's QP to the recorder, if one is active now."""
        self._record: Callable[[], None] = _nobody
        self._same_problem = False
        """Whether the next solve is a retry of the same problem."""
        recorder = recorder_now()
        if recorder is None:
            return
        statement = self.statement
        stream = recorder.stream(
            statement.name, self.tolerance, lambda given, memory: statement.instance(given, memory=memory)
        )

        def values() -> tuple[NDArray[np.float64], ...]:
            return self.parameters, self.memory

        self._record = recorder.watched(_nobody, stream, values, unless=lambda: self._same_problem)
        self.function.surround(lambda call: recorder.watched(call, stream, values, unless=lambda: self._same_problem))

    def _solve_by(self, name: str) -> bool:
        if name == FUSED:
            self.iterations = -1
            self.verdict[0] = math.nan
            self.function.evaluate()
        else:
            self._solve_apart(name)
        certified = is_certified(self.verdict[0], self.tolerance)
        if certified:
            self.keep[:] = self.answer
        return certified

    def _solve_apart(self, name: str) -> None:
        """Do the work of the fused function, but with another solver."""
        complete, build, certify, finish = self._complete, self._build, self._certify, self._finish
        full = _outputs(complete, self.parameters, self.memory)[0]
        *qp, valid = _outputs(build, full, self.memory)
        solver, n, m = self._backends[name], self.statement.n, self.statement.m
        assert solver is not None
        # A matrix with one column is flat.
        claim = solver.solve(Instance(qp[0].reshape(n, n), qp[1], qp[2].reshape(m, n), *qp[3:]))
        x, residual = _outputs(certify, *qp, valid, *claim[:3])
        report, memory, violation = _outputs(finish, full, self.memory, x)
        self._answer[:] = np.concatenate([x, *claim[1:3], memory])
        self._verdict[: 3 + len(report)] = np.concatenate([residual + violation, valid, [0.0], report])
        self.iterations = claim.iterations

    def _backend(self, argument: str, name: str) -> Backend | None:
        if name == FUSED:
            return None
        from rehab_opt.optim.backends import backend  # noqa: PLC0415  (solvers load when used)

        return backend(name, self.statement.n, self.statement.m, argument=argument)


def _nobody() -> None:
    """Do nothing; used without a recorder."""


def _outputs(function: BufferedFunction, *values: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    """Output buffers of a function, evaluated at `values`; its next call overwrites them."""
    for array, value in zip(function.inputs, values, strict=True):
        array[...] = value
    function()
    return function.outputs


@contextmanager
def as_in_c(*chains: FallbackChain) -> Iterator[None]:
    """Context in which a run is recorded for C: without backup solvers, because generated C has none.

    Raises `ConfigurationError` if the solver does not generate C.
    """
    for chain in chains:
        if chain.solver != FUSED:
            raise ConfigurationError("solver", chain.solver, f"{FUSED}, which can become C")
    backups = [chain.backup for chain in chains]
    try:
        for chain in chains:
            chain.backup = FUSED
        yield
    finally:
        for chain, backup in zip(chains, backups, strict=True):
            chain.backup = backup
