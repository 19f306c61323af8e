"""Solvers for a sequence of QPs of one size: proxqp, osqp, daqp, and those of qpsolvers."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple, Protocol

import numpy as np
import qpsolvers
import scipy.sparse as sp
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.rows import Instance

__all__ = [
    "DAQP_OPTIONS",
    "TIGHT",
    "Answer",
    "Backend",
    "DaqpBackend",
    "OsqpBackend",
    "ProxqpBackend",
    "QpsolversBackend",
    "answer_from",
    "backend",
    "has_finite_data",
    "no_answer",
    "to_qpsolvers",
]

Array = NDArray[np.float64]

UNBOUNDED = 1e8
"""Row limits of this size count as infinite; a statement uses them for a limit that does not apply now."""

OWN = ("proxqp", "osqp", "daqp")
"""Solvers with a backend in this module."""
PRECISION = 1e-10
"""Absolute tolerance of every solver, tight enough for the certificate."""
TIGHT: Mapping[str, Mapping[str, Any]] = {
    "clarabel": {"tol_gap_abs": PRECISION, "tol_gap_rel": 0.0, "tol_feas": PRECISION},
    "cvxopt": {"abstol": PRECISION, "reltol": PRECISION, "feastol": PRECISION},
    "daqp": {"primal_tol": PRECISION, "dual_tol": PRECISION},
    "ecos": {"abstol": PRECISION, "reltol": PRECISION, "feastol": PRECISION},
    "highs": {"primal_feasibility_tolerance": PRECISION, "dual_feasibility_tolerance": PRECISION},
    "osqp": {"eps_abs": PRECISION, "eps_rel": 0.0, "max_iter": 10_000},
    "piqp": {"eps_abs": PRECISION, "eps_rel": 0.0},
    "proxqp": {"eps_abs": PRECISION, "eps_rel": 0.0},
    "scs": {"eps_abs": PRECISION, "eps_rel": 0.0},
}
"""Options of the qpsolvers solvers that set `PRECISION`; quadprog has no such option."""
DAQP_TOLERANCES = 1e-10, 3e-9, 1e-7
"""Absolute feasibility tolerances, tried in this order, since rounding can make equal row limits seem to cross."""
DAQP_OPTIONS = {"dual_tol": 1e-12, "iter_limit": 1000}
"""Absolute dual tolerance; iteration cap."""
UNEVEN = 1e4
"""Ratio of the largest to the smallest curvature of variables above which the variables are scaled."""
FLAT = 1e-14
"""Fraction of the largest curvature below which a curvature counts as zero."""
EQUALITY, SOLVED = 5, 1
"""Codes of daqp for an equality and for a solved problem."""


class Answer(NamedTuple):
    """Solution that a solver claims; x is NaN if it found none. A multiplier is positive at an upper bound."""

    x: Array
    bound_multipliers: Array
    row_multipliers: Array
    iterations: int


class Backend(Protocol):
    """One solver, which starts each solve at its last answer."""

    name: str

    def forget(self) -> None:
        """Discard the warm start, so that the next solution does not depend on earlier ones."""
        ...

    def solve(self, qp: Instance) -> Answer:
        """Solution of `qp` as the solver claims it; numbers never raise an error."""
        ...


def no_answer(n: int, m: int) -> Answer:
    """Answer with NaN, which every certificate rejects."""
    return Answer(np.full(n, np.nan), np.full(n, np.nan), np.full(m, np.nan), -1)


def has_finite_data(qp: Instance) -> bool:
    """Whether a QP's data can be given to a solver: some solvers hang on NaN, others ignore a NaN bound."""
    costs_finite = np.isfinite(qp.H).all() and np.isfinite(qp.g).all() and np.isfinite(qp.A).all()
    bounds_ordered = (qp.lower <= qp.upper).all() and (qp.rows_lower <= qp.rows_upper).all()
    return bool(costs_finite and bounds_ordered)


def backend(name: str, n: int, m: int, *, argument: str = "solver") -> Backend:
    """Backend for QPs with n variables and m rows; raises `ConfigurationError` if no installed solver has this `name`.

    "proxqp" and "osqp" keep a workspace, "daqp" is called directly, and any other name goes to qpsolvers.
    """
    if name == "proxqp":
        return ProxqpBackend(n, m)
    if name == "osqp":
        return OsqpBackend(n, m)
    if name == "daqp":
        return DaqpBackend(n, m)
    return QpsolversBackend(name, argument=argument)


class ProxqpBackend:
    """Dense solver of proxsuite, updated in place.

    eps_primal_inf and eps_dual_inf are 0, since with the defaults the solver calls feasible problems infeasible. Both
    iteration counts are capped, since a NaN cost can occupy the solver for many seconds. The duality gap is checked: a
    multiplier z at a bound with slack s adds s z to the gap. The certificate limits min(s, z) to 1e-8, so the gap is
    limited to the square of 1e-8. Answers are not repeatable to the last bit, since sums depend on the address of the
    workspace.
    """

    name = "proxqp"

    def __init__(self, n: int, m: int) -> None:
        self._n, self._m = n, m
        self.forget()

    def forget(self) -> None:
        """Make a new workspace, since scaling and step sizes survive a cold start."""
        from proxsuite import proxqp  # noqa: PLC0415  (loads when used)

        n, m, self._ready = self._n, self._m, False
        self._qp, self._solved = proxqp.dense.QP(n, 0, m, True), proxqp.PROXQP_SOLVED
        settings = self._qp.settings
        settings.eps_abs, settings.eps_rel = PRECISION / 10, 0.0  # at `PRECISION` some ticks stop too early
        settings.eps_primal_inf = settings.eps_dual_inf = 0.0
        settings.check_duality_gap, settings.eps_duality_gap_abs = True, 1e-16
        settings.eps_duality_gap_rel = 1e-15  # rounding of the two costs of the gap
        settings.max_iter, settings.max_iter_in = 100, 100
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT

    def solve(self, qp: Instance) -> Answer:
        """Solution of `qp` as proxqp claims it."""
        n, m = self._n, self._m
        if not has_finite_data(qp):
            return no_answer(n, m)
        fresh = not self._ready
        matrices = {
            "H": qp.H, "g": qp.g, "C": qp.A if m else None, "l": qp.rows_lower if m else None,
            "u": qp.rows_upper if m else None, "l_box": qp.lower, "u_box": qp.upper,
        }  # fmt: skip
        if self._ready:
            self._qp.update(**matrices)
        else:
            self._qp.init(**matrices)
            self._ready = True
        self._qp.solve()
        if self._qp.results.info.status != self._solved and not fresh:
            self.forget()  # scaling and warm start came from problems too different
            return self.solve(qp)
        result = self._qp.results
        x, z = np.array(result.x), np.array(result.z)
        if not (np.all(np.isfinite(x)) and np.all(np.isfinite(z))):
            self.forget()  # a poisoned warm start would fail every later solve
            return no_answer(n, m)
        return Answer(x, z[m:], z[:m], int(result.info.iter))


class OsqpBackend:
    """osqp, set up once with dense matrices, so that every later problem is an update."""

    name = "osqp"

    def __init__(self, n: int, m: int) -> None:
        self._n, self._m = n, m
        self._upper = np.triu_indices(n)
        # Column-major order of the upper triangle, and of the stacked [A; I]: fixed patterns with explicit zeros.
        order = np.lexsort((self._upper[0], self._upper[1]))
        self._upper = (self._upper[0][order], self._upper[1][order])
        self.forget()

    def forget(self) -> None:
        """Discard the setup; the next problem makes a new one."""
        self._solver: Any = None

    def solve(self, qp: Instance) -> Answer:
        """Solution of `qp` as osqp claims it."""
        n, m = self._n, self._m
        if not has_finite_data(qp):
            return no_answer(n, m)
        lower = np.concatenate([qp.rows_lower, qp.lower])
        upper = np.concatenate([qp.rows_upper, qp.upper])
        stacked = np.vstack([qp.A, np.eye(n)])
        import osqp  # noqa: PLC0415  (loads when used)

        try:
            if self._solver is None:
                self._solver = self._set_up(qp, stacked, lower, upper)
            else:
                self._solver.update(
                    Px=qp.H[self._upper], q=np.array(qp.g), Ax=stacked.reshape(-1, order="F"), l=lower, u=upper
                )
            result = self._solver.solve(raise_error=False)
        except osqp.OSQPException:
            self.forget()  # osqp refuses a concave cost, or numbers out of its range
            return no_answer(n, m)
        if not (np.all(np.isfinite(result.x)) and np.all(np.isfinite(result.y))):
            self.forget()
            return no_answer(n, m)
        return Answer(np.array(result.x), np.array(result.y[m:]), np.array(result.y[:m]), int(result.info.iter))

    def _set_up(self, qp: Instance, stacked: Array, lower: Array, upper: Array) -> Any:
        import osqp  # noqa: PLC0415  (loads when used)

        n, rows = self._n, stacked.shape[0]
        starts = np.concatenate([[0], np.cumsum(np.arange(1, n + 1))])
        hessian = sp.csc_matrix((qp.H[self._upper], self._upper[0], starts), shape=(n, n))
        matrix = sp.csc_matrix(
            (stacked.reshape(-1, order="F"), np.tile(np.arange(rows), n), np.arange(n + 1) * rows), shape=(rows, n)
        )
        solver = osqp.OSQP()
        # A fixed adaption interval: the default depends on time, and so would the answer.
        solver.setup(
            hessian, np.array(qp.g), matrix, lower, upper, verbose=False, eps_abs=PRECISION, eps_rel=0.0,
            polishing=False, max_iter=10_000, adaptive_rho_interval=50, warm_starting=True,
        )  # fmt: skip
        return solver


class DaqpBackend:
    """Solver daqp, called without a warm start; a failed solve does not affect the next one.

    Badly scaled variables are scaled to curvature 1. daqp regularises a cost that is not strictly convex, or fails.
    """

    name = "daqp"

    def __init__(self, n: int, m: int) -> None:
        self._daqp: Any = import_module("daqp").solve  # loads when used
        self._n, self._m = n, m
        self._lower, self._upper = np.empty(n + m), np.empty(n + m)
        self._kinds = np.zeros(n + m, dtype=np.intc)

    def forget(self) -> None:
        """Do nothing: daqp starts without a warm start."""

    def solve(self, qp: Instance) -> Answer:
        """Solution of `qp` as daqp claims it."""
        n, m = self._n, self._m
        if not has_finite_data(qp):
            return no_answer(n, m)
        curvatures = qp.H.diagonal()
        largest = curvatures.max()
        if largest > UNEVEN * curvatures.min() and largest > 0:
            return self._scaled(qp, 1.0 / np.sqrt(np.maximum(curvatures, FLAT * largest)))
        return self._asked(qp)

    def _scaled(self, qp: Instance, units: Array) -> Answer:
        """Solve `qp` in scaled variables y, where x = units * y; the answer is in x."""
        claim = self._asked(
            qp._replace(
                H=qp.H * np.outer(units, units), g=qp.g * units, A=qp.A * units,
                lower=qp.lower / units, upper=qp.upper / units,
            )
        )  # fmt: skip
        return claim._replace(x=claim.x * units, bound_multipliers=claim.bound_multipliers / units)

    def _asked(self, qp: Instance) -> Answer:
        n, m = self._n, self._m
        lower, upper, kinds = self._lower, self._upper, self._kinds
        lower[:n], lower[n:], upper[:n], upper[n:] = qp.lower, qp.rows_lower, qp.upper, qp.rows_upper
        kinds[:n], kinds[n:] = 0, EQUALITY * (qp.rows_lower == qp.rows_upper)
        # daqp reads H by its address and refuses read-only arrays, although it writes to none.
        cost = np.array(qp.H, order="C"), np.array(qp.g)
        for tolerance in DAQP_TOLERANCES:
            x, _, flag, told = self._daqp(
                *cost, np.array(qp.A, order="C"), upper, lower, kinds, primal_tol=tolerance, **DAQP_OPTIONS
            )
            if flag == SOLVED and np.isfinite(x).all():
                pushes = told["lam"]
                return Answer(x, pushes[:n], pushes[n:], int(told["iterations"]))
        return no_answer(n, m)


class QpsolversBackend:
    """Any solver of qpsolvers by name, for comparison: it builds each problem anew."""

    def __init__(self, name: str, *, argument: str = "solver") -> None:
        if name not in qpsolvers.available_solvers:
            known = ", ".join(["qrqp", *OWN, *sorted(set(qpsolvers.available_solvers) - {*OWN})])
            raise ConfigurationError(argument, name, f"an installed solver: {known}")
        self.name = name
        self._options = TIGHT.get(name, {})

    def forget(self) -> None:
        """Do nothing: each problem is built anew."""

    def solve(self, qp: Instance) -> Answer:
        """Solution of `qp` as the solver claims it."""
        n, m = qp.g.size, qp.rows_lower.size
        if not has_finite_data(qp):
            return no_answer(n, m)
        problem = to_qpsolvers(qp)
        try:
            solution = qpsolvers.solve_problem(problem, solver=self.name, **self._options)
        except (qpsolvers.exceptions.QPError, ValueError, ArithmeticError, RuntimeError):
            return no_answer(n, m)  # solvers report failure in different ways
        return answer_from(qp, solution)


def answer_from(qp: Instance, solution: qpsolvers.Solution) -> Answer:
    """Answer from the solution that qpsolvers returned for `to_qpsolvers(qp)`."""
    n, m = qp.g.size, qp.rows_lower.size
    if not solution.found or solution.x is None:
        return no_answer(n, m)
    given = solution.z_box is not None and np.size(solution.z_box) == n
    bounds = np.asarray(solution.z_box, dtype=np.float64) if given else np.zeros(n)
    return Answer(np.asarray(solution.x, dtype=np.float64), bounds, _row_multipliers(qp, solution), -1)


def to_qpsolvers(qp: Instance) -> qpsolvers.Problem:
    """`qp` in qpsolvers' form: equal row limits become A x = b, other finite ones G x <= h."""
    equality, above, below = _sides(qp)
    inequalities = [qp.A[above], -qp.A[below]]
    limits = [qp.rows_upper[above], -qp.rows_lower[below]]
    has_rows, has_equalities = bool(above.any() or below.any()), bool(equality.any())
    return qpsolvers.Problem(
        np.array(qp.H),
        np.array(qp.g),
        np.vstack(inequalities) if has_rows else None,
        np.concatenate(limits) if has_rows else None,
        qp.A[equality] if has_equalities else None,
        qp.rows_upper[equality] if has_equalities else None,
        np.array(qp.lower),
        np.array(qp.upper),
    )


def _sides(qp: Instance) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    equality = qp.rows_lower == qp.rows_upper
    return equality, ~equality & (qp.rows_upper < UNBOUNDED), ~equality & (qp.rows_lower > -UNBOUNDED)


def _row_multipliers(qp: Instance, solution: qpsolvers.Solution) -> Array:
    equality, above, below = _sides(qp)
    multipliers = np.zeros(qp.rows_lower.size)
    if solution.y is not None and equality.any():
        multipliers[equality] = solution.y
    if solution.z is not None and (above.any() or below.any()):
        count = int(above.sum())
        multipliers[above] += solution.z[:count]
        multipliers[below] -= solution.z[count:]
    return multipliers
