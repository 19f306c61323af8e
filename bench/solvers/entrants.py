"""Who takes part in the comparison: each solver as one small adapter, from an instance to a claim."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from bench.qp_recording.sequence import QPSequence
from bench.solvers.dense_qp import Certificate, DenseQP
from bench.solvers.entrant import Claim, Entrant, Solver
from bench.solvers.instances import RecordedQPs
from bench.solvers.programmes import PROGRAMME_ENTRANTS
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.backends import TIGHT, Answer, Backend, answer_from, backend, to_qpsolvers
from rehab_opt.optim.certificate import is_certified
from rehab_opt.optim.fallback_chain import BACKUP
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import Compile

__all__ = ["KEPT", "entrants", "entrants_named"]

KEPT = ("proxqp", "osqp", "daqp")
"""Solvers with a backend of ours, which keeps a workspace, or is asked directly (daqp)."""
OTHER_BACKUPS = ("proxqp",)
"""Of the same fallback, to see what the backup costs."""
BOUNDS_AS_ROWS = ("cvxopt", "ecos", "quadprog")
"""qpsolvers gives these every bound as a row, also an infinite one, which they cannot read."""


def entrants() -> tuple[Entrant, ...]:
    """Every installed solver: of QPs ours first, then those of qpsolvers by name, then those of programmes."""
    import qpsolvers  # noqa: PLC0415  (it loads every solver it finds)

    ours = (
        Entrant("fallback", both_stages, BACKUP, ("casadi", BACKUP)),
        *(
            Entrant(f"fallback-{name}", both_stages, name, ("casadi", PACKAGES.get(name, name)))
            for name in OTHER_BACKUPS
        ),
        Entrant("qrqp-fused", fused_qrqp, "compiled", ("casadi",)),
        Entrant("qrqp-virtual", fused_qrqp, "virtual", ("casadi",)),
        *(Entrant(f"{name}-kept", kept_alive, name, (PACKAGES.get(name, name),)) for name in KEPT),
    )
    theirs = (
        Entrant(name, by_qpsolvers, name, ("qpsolvers", PACKAGES.get(name, name)))
        for name in sorted(qpsolvers.available_solvers)
    )
    return (*ours, *theirs, *PROGRAMME_ENTRANTS)


PACKAGES: Mapping[str, str] = {"proxqp": "proxsuite", "highs": "highspy"}
"""Distributions that are called otherwise than their solver."""


def entrants_named(names: Sequence[str] | None) -> tuple[Entrant, ...]:
    """Those of the given names, all of them for none.

    Raises
    ------
    ConfigurationError : a name that is none of theirs.
    """
    known = {entrant.name: entrant for entrant in entrants()}
    for name in names or ():
        if name not in known:
            raise ConfigurationError("--solver", name, f"an installed solver: {', '.join(known)}")
    return tuple(entrant for entrant in known.values() if not names or entrant.name in names)


def fused_qrqp(recorded: RecordedQPs, solver: str) -> Solver:
    """The way of our controllers; its word is its certificate."""
    return _Fused(recorded.sequence, compile=None if solver == "compiled" else False)


def both_stages(recorded: RecordedQPs, solver: str) -> Solver:
    """What our controllers do: fused qrqp, then the backup, then qrqp once more without its warm start."""
    return _Ladder(recorded.sequence, solver)


def kept_alive(recorded: RecordedQPs, solver: str) -> Solver:
    """The backup's way: a backend of ours, and the certificate as its word."""
    return _Kept(recorded.sequence, solver)


def by_qpsolvers(recorded: RecordedQPs, solver: str) -> Solver:
    """A fresh call of qpsolvers; warm means the last answer as `initvals`, which few of its solvers use."""
    return _Qpsolvers(solver)


class _Fused:
    def __init__(self, sequence: QPSequence, *, compile: Compile) -> None:
        self._tolerance = sequence.tolerance
        self._qp = DenseQP.of(sequence, compile=compile)

    def prepared(self, qp: Instance) -> Any:
        return self._qp.flat(qp)

    def solve(self, given: Any, *, warm: bool) -> Any:
        return self._qp.solve(given, warm=warm)

    def claim(self, qp: Instance, answered: Any) -> Claim:
        found, residual = answered
        return _certified_claim(self._qp.parted(found), residual, self._tolerance)


class _Kept:
    def __init__(self, sequence: QPSequence, solver: str) -> None:
        self._make: Callable[[], Backend] = lambda: backend(solver, sequence.n, sequence.m)
        self._backend, self._tolerance = self._make(), sequence.tolerance
        self._certificate = Certificate(sequence.n, sequence.m)

    def prepared(self, qp: Instance) -> Any:
        return qp

    def solve(self, given: Any, *, warm: bool) -> Any:
        if not warm:
            self._backend = self._make()
        answer = self._backend.solve(given)
        return answer, self._certificate.residual(given, answer)

    def claim(self, qp: Instance, answered: Any) -> Claim:
        answer, residual = answered
        return _certified_claim(answer, residual, self._tolerance)


class _Ladder(_Kept):
    def __init__(self, sequence: QPSequence, backup: str) -> None:
        super().__init__(sequence, backup)
        self._qp = DenseQP.of(sequence)

    def prepared(self, instance: Any) -> Any:
        return instance, self._qp.flat(instance)

    def solve(self, given: Any, *, warm: bool) -> Any:
        instance, flat = given
        found, residual = self._qp.solve(flat, warm=warm)
        if is_certified(residual, self._tolerance):
            return self._qp.parted(found), residual
        answer, residual = super().solve(instance, warm=warm)
        if is_certified(residual, self._tolerance):
            self._qp.warm_start(answer)
        elif warm:
            found, residual = self._qp.solve(flat, warm=False)
            answer = self._qp.parted(found)
        return answer, residual


class _Qpsolvers:
    def __init__(self, solver: str) -> None:
        import qpsolvers  # noqa: PLC0415

        self._solve: Any
        self._solve, self._solver, self._options = qpsolvers.solve_problem, solver, dict(TIGHT.get(solver, {}))
        self._refused = qpsolvers.exceptions.QPError
        self._sparse = solver not in qpsolvers.dense_solvers
        self._last: Any = None
        self._takes_start = solver != "highs"  # it warns of each start it is given

    def prepared(self, qp: Instance) -> Any:
        stated = self._stated(qp)
        problem: Any = to_qpsolvers(stated)
        if stated is not qp:
            problem.lb = problem.ub = None
        if self._sparse:
            from scipy import sparse  # noqa: PLC0415

            for matrix in ("P", "G", "A"):
                if getattr(problem, matrix) is not None:
                    setattr(problem, matrix, sparse.csc_matrix(getattr(problem, matrix)))
        return problem

    def solve(self, given: Any, *, warm: bool) -> Any:
        start = self._last if warm and self._takes_start else None
        try:
            solution = self._solve(given, self._solver, initvals=start, **self._options)
        except self._refused as refusal:  # how qpsolvers says no
            return str(refusal)
        self._last = solution.x if solution.found else None
        return solution

    def claim(self, qp: Instance, answered: Any) -> Claim:
        n, m = qp.g.size, qp.rows_lower.size
        if isinstance(answered, str):
            return Claim(False, Answer(np.full(n, np.nan), np.zeros(n), np.zeros(m), -1), answered)
        stated = self._stated(qp)
        answer = answer_from(stated, answered)
        if stated is not qp:
            bounds = np.zeros(n)
            bounds[_finite(qp)] = answer.row_multipliers[m:]
            answer = Answer(answer.x, bounds, answer.row_multipliers[:m], -1)
        return Claim(bool(answered.found), answer)

    def _stated(self, qp: Instance) -> Instance:
        """The same QP with its finite bounds as rows, where the solver cannot read infinite ones."""
        finite = _finite(qp)
        if self._solver not in BOUNDS_AS_ROWS or (np.isfinite(qp.lower).all() and np.isfinite(qp.upper).all()):
            return qp
        rows = np.vstack([qp.A, np.eye(qp.g.size)[finite]])
        lower = np.concatenate([qp.rows_lower, qp.lower[finite]])
        upper = np.concatenate([qp.rows_upper, qp.upper[finite]])
        free = np.full(qp.g.size, np.inf)
        return Instance(qp.H, qp.g, rows, lower, upper, -free, free)


def _finite(qp: Instance) -> Any:
    return np.isfinite(qp.lower) | np.isfinite(qp.upper)


def _certified_claim(answer: Answer, residual: float, tolerance: float) -> Claim:
    certified = is_certified(residual, tolerance)
    return Claim(certified, answer, "" if certified else f"residual {residual:.1e}")
