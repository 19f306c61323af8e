"""daqp as a backend: a dual active-set method whose slowest solve is little slower than its usual one."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.optim.answer import Answer, has_finite_data, no_answer
from rehab_opt.optim.rows import Instance

__all__ = ["DaqpBackend"]

Array = NDArray[np.float64]

PRIMAL = 1e-10, 3e-9, 1e-7
"""Absolute, in turn: where rows leave nothing between them, it finds by rounding that they leave less."""
OPTIONS = {"dual_tol": 1e-12, "iter_limit": 1000}
"""Absolute; the QPs of `bench/solvers/qp` take 62 iterations at most."""
UNEVEN = 1e4
"""Ratio of the largest curvature along a variable to the smallest from which their units are made alike."""
FLAT = 1e-14
"""Share of the largest curvature that counts as none."""
EQUALITY, SOLVED = 5, 1
"""daqp's own words."""


class DaqpBackend:
    """daqp, asked anew each time.

    That takes a few tens of us; nothing of a failed solve reaches the next. Badly scaled variables are scaled to the
    curvature 1: unscaled it solves 12 % of the badly scaled QPs of `bench/solvers/qp`, scaled all. A cost that is not
    strictly convex is regularised by daqp, or fails.
    """

    name = "daqp"

    def __init__(self, n: int, m: int) -> None:
        self._daqp: Any = import_module("daqp").solve  # loads when used
        self._n, self._m = n, m
        self._lower, self._upper = np.empty(n + m), np.empty(n + m)
        self._kinds = np.zeros(n + m, dtype=np.intc)

    def forget(self) -> None:
        """Nothing is remembered."""

    def solve(self, qp: Instance) -> Answer:
        """Claimed solution of `qp`."""
        n, m = self._n, self._m
        if not has_finite_data(qp):
            return no_answer(n, m)
        curvatures = qp.H.diagonal()
        largest = curvatures.max()
        if largest > UNEVEN * curvatures.min() and largest > 0:
            return self._scaled(qp, 1.0 / np.sqrt(np.maximum(curvatures, FLAT * largest)))
        return self._asked(qp)

    def _scaled(self, qp: Instance, units: Array) -> Answer:
        """`qp` over y with x = units y."""
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
        # It reads H by its address, and writes to nothing, but refuses what it might not write to.
        cost = np.array(qp.H, order="C"), np.array(qp.g)
        for tolerance in PRIMAL:
            x, _, flag, told = self._daqp(
                *cost, np.array(qp.A, order="C"), upper, lower, kinds, primal_tol=tolerance, **OPTIONS
            )
            if flag == SOLVED and np.isfinite(x).all():
                pushes = told["lam"]
                return Answer(x, pushes[:n], pushes[n:], int(told["iterations"]))
        return no_answer(n, m)
