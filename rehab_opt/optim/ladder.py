"""Primary solver, then a backup of another kind; an answer leaves only with its certificate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import is_certified
from rehab_opt.optim.qp import Instance, Statement
from rehab_opt.symbolic import BufferedFunction, compiled

if TYPE_CHECKING:
    from rehab_opt.optim.backends import Backend

__all__ = ["FUSED", "GUESS", "Ladder"]

FUSED = "qrqp"
"""Name of the solver inside the fused function."""
GUESS = "closed form"
"""Name under which the statement's certified guess answers."""


class Ladder:
    """Solves one statement tick after tick.

    Write the parameters into `parameters`, call, and read `x`, `residual`, `notes` and `report`; all are arrays that
    the next call overwrites. The call returns the name of the solver whose answer is certified, "" if none is; only a
    certified answer changes `state` (x, multipliers, memory), which the next call starts from.

    Parameters
    ----------
    statement : the QP.
    solver, backup : "qrqp" (fused), "proxqp" or "osqp" (kept alive), or any solver known to qpsolvers.
    tolerance : largest certificate residual that is accepted, in the statement's units.
    compile : None follows `REHAB_OPT_COMPILE`.
    """

    def __init__(
        self, statement: Statement, *, solver: str, backup: str, tolerance: float, compile: bool | None = None
    ) -> None:
        if not 0 < tolerance < 1:
            raise ConfigurationError("tolerance", tolerance, "a number between 0 and 1")
        self.statement, self.solver, self.backup, self.tolerance = statement, solver, backup, tolerance
        self._buffers = fused = BufferedFunction(compiled(statement.fused, compile=compile))
        self._fused = fused.evaluate  # its memory belongs to `_buffers`
        self.parameters, self.state = fused.inputs
        self._answer, judged, self.notes, self.report = fused.outputs
        self.residual, self.sound = judged[:1], judged[1:2]
        self._judged, self._read_answer = judged.data, self._answer.data
        self._write_state = self.state.data  # assignment from view to view costs half of numpy's
        self.x = self._answer[: statement.n]
        self.memory = self.state[2 * statement.n + statement.m :]
        self.iterations = -1
        self._rungs = {name: None if name == FUSED else self._backend(name) for name in (solver, backup)}
        # The parts are made now: a first failure in the loop must not wait for a compiler. They are compiled only
        # where they serve the primary solver.
        parts = (statement.complete, statement.build, statement.certify, statement.finish)
        wanted = compile if solver != FUSED else False
        self._complete, self._build, self._certify, self._finish = (
            BufferedFunction(compiled(part, compile=wanted)) for part in parts
        )

    def __call__(self) -> str:
        """Solve at `parameters`, warm-started; name of the solver that is certified, or ""."""
        if self.solver == FUSED:
            self.iterations = -1
            self._fused()
            if 0.0 <= self._judged[0] <= self.tolerance:
                self._write_state[:] = self._read_answer
                return GUESS if self._judged[2] else FUSED
        elif self._solve_by(self.solver):
            return self.solver
        if not self.sound[0]:
            return ""  # the parameters themselves cannot be used
        # An active set from the last tick can lead qrqp astray where a cold start does not: one in a few hundred of
        # random states, and none of the continuous motions tried.
        self.start_from(0.0)
        if self.solver == FUSED and self._solve_by(FUSED):
            return FUSED
        if self.backup != self.solver and self._solve_by(self.backup):
            return self.backup
        return ""

    def start_from(self, x: ArrayLike) -> None:
        """Forget the warm start, not the memory; begin at x (n,) or a scalar, with no active bound."""
        n = self.statement.n
        self.state[n : 2 * n + self.statement.m] = 0.0
        self.state[:n] = x

    def _solve_by(self, name: str) -> bool:
        if name == FUSED:
            self._fused()
            certified = is_certified(self._judged[0], self.tolerance)
            if certified:
                self.state[:] = self._answer
            return certified
        complete, build, certify, finish = self._complete, self._build, self._certify, self._finish
        complete.inputs[0][:], complete.inputs[1][:] = self.parameters, self.memory
        complete()
        full = complete.outputs[0]
        build.inputs[0][:], build.inputs[1][:] = full, self.memory
        build()
        *qp, sound, notes, _ = build.outputs
        solver = self._rungs[name]
        assert solver is not None
        answer = solver.solve(Instance(*qp))
        for array, number in zip(certify.inputs, (*qp, sound, *answer[:3]), strict=True):
            array[...] = number
        certify()
        x, residual = certify.outputs
        for array, number in zip(finish.inputs, (full, self.memory, x), strict=True):
            array[:] = number
        finish()
        report, memory = finish.outputs
        self._answer[:] = np.concatenate([x, *answer[1:3], memory])
        self.residual[:], self.sound[:], self.notes[:], self.report[:] = residual, sound, notes, report
        self.iterations = answer.iterations
        if not is_certified(self._judged[0], self.tolerance):
            return False
        self.state[:] = self._answer
        return True

    def _backend(self, name: str) -> Backend:
        from rehab_opt.optim.backends import backend  # noqa: PLC0415  (solvers load when used)

        return backend(name, self.statement.n, self.statement.m)
