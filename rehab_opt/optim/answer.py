"""A solver's claimed solution, and the interface of a QP solver."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rehab_opt.optim.rows import Instance

__all__ = ["Answer", "Backend", "has_finite_data", "no_answer"]

Array = NDArray[np.float64]


class Answer(NamedTuple):
    """A claimed solution; NaN in x where the solver gave none. Multipliers are positive at an upper bound."""

    x: Array
    bound_multipliers: Array
    row_multipliers: Array
    iterations: int


class Backend(Protocol):
    """One solver, warm-started from its last answer."""

    name: str

    def forget(self) -> None:
        """Begin anew: what is solved next depends on nothing that was solved before."""
        ...

    def solve(self, qp: Instance) -> Answer:
        """Claimed solution of `qp`; never raises on numbers."""
        ...


def no_answer(n: int, m: int) -> Answer:
    """What no certificate accepts."""
    return Answer(np.full(n, np.nan), np.full(n, np.nan), np.full(m, np.nan), -1)


def has_finite_data(qp: Instance) -> bool:
    """Whether a solver may see this: NaN hangs some, and a NaN bound is no bound to others."""
    costs_finite = np.isfinite(qp.H).all() and np.isfinite(qp.g).all() and np.isfinite(qp.A).all()
    bounds_ordered = (qp.lower <= qp.upper).all() and (qp.rows_lower <= qp.rows_upper).all()
    return bool(costs_finite and bounds_ordered)
