"""Nonlinear solvers of CasADi by name, behind one interface: quiet, with capped iterations, certified."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import is_certified
from rehab_opt.optim.nlp import MAX_MAGNITUDE, NLP, NLPAnswer, convexified
from rehab_opt.optim.nlp_sqp import SQP
from rehab_opt.optim.qrqp import qrqp_options, with_spare_room
from rehab_opt.symbolic import BufferedFunction, Compile, compiled

__all__ = ["NLPSolver", "checked_name", "nlp_solver"]

Array = NDArray[np.float64]

SQPMETHOD_CHANGES = 100
"""Cap on the active-set changes of a QP in CasADi's sqpmethod."""
WIDENING = 1e-8
"""fatrop widens inequality bounds by this; CasADi 3.8 does not pass on the option for it."""


def checked_name(argument: str, name: object) -> str:
    """The same `name`; raises `ConfigurationError` if no solver has it."""
    if not (isinstance(name, str) and (name == SQP.name or (name.isidentifier() and ca.has_nlpsol(name)))):
        raise ConfigurationError(argument, name, "'sqp', 'ipopt', 'fatrop', 'sqpmethod' or another of CasADi's")
    return name


def nlp_solver(
    nlp: NLP,
    name: str,
    *,
    tolerance: float = 1e-9,
    max_iterations: int | None = None,
    compile: Compile = None,
) -> SQP | NLPSolver:
    """Solver of `nlp`: "sqp" (ours, fused), "ipopt", "fatrop", "sqpmethod", or another `nlpsol` plugin by name."""
    cap: dict[str, Any] = {} if max_iterations is None else {"max_iterations": max_iterations}
    if name == SQP.name:
        return SQP(nlp, tolerance=tolerance, compile=compile, **cap)
    return NLPSolver(nlp, name, tolerance=tolerance, compile=compile, **cap)


class NLPSolver:
    """One of CasADi's `nlpsol` plugins; an unknown name raises `ConfigurationError`.

    The plugin's own tolerances are tighter, so that `tolerance` refers to the certificate's residual.

    Parameters
    ----------
    name : "ipopt", "fatrop", "sqpmethod" (with qrqp and a convexified Hessian), or another plugin, at its defaults.
    tolerance : largest accepted residual.
    max_iterations : cap on iterations.
    compile : whether to compile sqpmethod, and wait for it; see `compiled`.
    """

    def __init__(
        self,
        nlp: NLP,
        name: str,
        *,
        tolerance: float = 1e-9,
        max_iterations: int = 200,
        compile: Compile = None,
    ) -> None:
        checked_name("solver", name)
        if not 0 < tolerance < 1:
            raise ConfigurationError("tolerance", tolerance, "a number above 0 and below 1")
        self.nlp, self.name, self.tolerance = nlp, name, float(tolerance)
        problem = {"x": nlp.x, "p": nlp.p, "f": nlp.minimise, "g": nlp.rows.expression}
        options = _options(nlp, name, self.tolerance, max_iterations)
        self._solver = ca.nlpsol(f"{nlp.name}_{name}", name, problem, options)
        if name == "sqpmethod":
            self._solver = with_spare_room(self._solver)  # qrqp works inside
        # In the virtual machine the plugin itself is called, since it also reports its iterations.
        fast = compiled(self._solver, compile=compile) if name == "sqpmethod" else self._solver
        self._fast = None if fast is self._solver else BufferedFunction(fast)
        self._bounds, self._certify = BufferedFunction(nlp.bounds), BufferedFunction(nlp.certify)
        self.parameters = np.zeros(nlp.p.numel())

    def solve(self, start: ArrayLike, multipliers: ArrayLike = 0.0) -> NLPAnswer:
        """Solve from `start` (n,) and earlier `multipliers` (n + m,); the caller first fills `parameters`."""
        n = self.nlp.n
        x, y = np.zeros(n), np.zeros(n + self.nlp.m)
        x[:], y[:] = start, multipliers
        # fatrop may run for ever on NaN despite its iteration cap, so such data reach no solver.
        if not all(np.all(np.abs(each) <= MAX_MAGNITUDE) for each in (self.parameters, x, y)):
            return self._certified(x, y, 0)
        self._bounds.inputs[0][:] = self.parameters
        self._bounds()
        lower, upper, rows_lower, rows_upper = self._bounds.outputs
        if np.count_nonzero(rows_lower == rows_upper) > n:  # overdetermined: CasADi would warn on the terminal
            return self._certified(x, y, 0)
        if self.name == "fatrop":
            (lower, upper), (rows_lower, rows_upper) = _narrowed(lower, upper), _narrowed(rows_lower, rows_upper)
        iterations = -1
        if self._fast is not None:
            values = (x, self.parameters, lower, upper, rows_lower, rows_upper, y[:n], y[n:])
            for array, value in zip(self._fast.inputs, values, strict=True):
                array[...] = value
            self._fast()
            # nlpsol's outputs: x, f, g, lam_x, lam_g, lam_p
            claim, _, _, of_bounds, of_rows, _ = self._fast.outputs
        else:
            try:
                found = self._solver(
                    x0=x, p=self.parameters, lbx=lower, ubx=upper, lbg=rows_lower, ubg=rows_upper,
                    lam_x0=y[:n], lam_g0=y[n:],
                )  # fmt: skip
            except RuntimeError:  # a plugin's refusal counts as a failure to solve
                return self._certified(x, y, -1)
            claim, of_bounds, of_rows = (found[key].full().reshape(-1) for key in ("x", "lam_x", "lam_g"))
            iterations = -1 if self.name == "sqpmethod" else _iterations(self._solver.stats())
        return self._certified(claim, np.concatenate([of_bounds, of_rows]), iterations)

    def _certified(self, claim: Any, multipliers: Any, iterations: int) -> NLPAnswer:
        inputs = self._certify.inputs
        inputs[0][:], inputs[1][:], inputs[2][:] = self.parameters, claim, multipliers
        self._certify()
        x, cost, residual, violation, report = self._certify.outputs
        return NLPAnswer(
            x.copy(), multipliers, float(cost[0]), float(residual[0]), float(violation[0]), report.copy(),
            iterations, self.name, is_certified(float(residual[0]), self.tolerance),
        )  # fmt: skip


def _narrowed(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Bounds tightened in advance, so that fatrop's own widening (1e-8, relative above 1) gives the intended ones.

    Equalities stay unchanged.
    """
    with np.errstate(invalid="ignore"):
        room = np.where(upper > lower, np.maximum(upper - lower, 0.0) / 4, 0.0)
    by_lower, by_upper = (np.minimum(WIDENING * np.maximum(1.0, np.abs(bound)), room) for bound in (lower, upper))
    return (
        np.where(np.isfinite(lower), lower + np.where(np.isfinite(by_lower), by_lower, 0.0), lower),
        np.where(np.isfinite(upper), upper - np.where(np.isfinite(by_upper), by_upper, 0.0), upper),
    )


def _iterations(stats: dict[str, Any]) -> int:
    return int(stats.get("iter_count", stats.get("fatrop", {}).get("iterations_count", -1)))


def _options(nlp: NLP, name: str, tolerance: float, max_iterations: int) -> dict[str, Any]:
    """Options for the plugin: no output, no exceptions, capped iterations, and tolerances tighter than `tolerance`."""
    common: dict[str, Any] = {"error_on_fail": False, "print_time": False, "show_eval_warnings": False}
    common["calc_lam_p"] = False  # not needed, and CasADi would warn on the terminal after a failed solve
    tight = 0.1 * tolerance
    if name == "ipopt":
        own: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "max_iter": max_iterations,
            "tol": tight,
            "constr_viol_tol": tight,
            "dual_inf_tol": tight,
            "compl_inf_tol": tight,
            "acceptable_iter": 0,
            "bound_relax_factor": 0.0,
        }
        return {**common, "ipopt": own}
    if name == "fatrop":
        return {**common, "fatrop": {"print_level": 0, "max_iter": max_iterations, "tol": tight}}
    if name == "sqpmethod":
        return {
            **common,
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
            "max_iter": max_iterations,
            "tol_pr": tight,
            "tol_du": tight,
            "hess_lag": _convex_hessian(nlp),
            "qpsol": "qrqp",
            "qpsol_options": qrqp_options(SQPMETHOD_CHANGES),
        }
    return common


def _convex_hessian(nlp: NLP) -> ca.Function:
    of_cost, of_rows = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", nlp.m)
    lagrangian = of_cost * nlp.minimise + ca.dot(of_rows, nlp.rows.expression)
    hessian = convexified(ca.hessian(lagrangian, nlp.x)[0])
    inputs = [nlp.x, nlp.p, of_cost, of_rows]
    names = ["x", "p", "lam_f", "lam_g"]
    return ca.Function("nlp_hess_l", inputs, [hessian], names, ["hess_gamma_x_x"], {"cse": True})
