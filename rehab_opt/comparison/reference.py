"""The answer that others are compared with, and how well it is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.comparison.dense_qp import Certificate, DenseQP
from rehab_opt.comparison.sequence import QPSequence
from rehab_opt.optim.backends import Answer, ProxqpBackend
from rehab_opt.optim.qp import Instance

__all__ = ["ACCURACY", "Reference", "references"]

Array = NDArray[np.float64]

ACCURACY = 1e-10
"""Residual that a reference is solved to, absolute, in the statement's units."""
UNIQUE = 1e-10
"""Smallest eigenvalue of H beside its largest from which the answer is taken as unique."""


class Reference(NamedTuple):
    """One tick's answer."""

    x: Array
    residual: float
    solver: str
    """"" where there is none."""
    unique: bool
    """Whether the cost is strictly convex, so that a distance from x means something."""

    def distance(self, x: Array) -> float:
        """2-norm of the difference; NaN where it means nothing."""
        return float(np.linalg.norm(x - self.x)) if self.unique and self.residual <= ACCURACY else np.nan


def references(sequence: QPSequence) -> tuple[Reference, ...]:
    """For every tick: qrqp cold, proxqp where its certificate is above `ACCURACY`, each improved on its active set."""
    fused, certificate = DenseQP(sequence.n, sequence.m, compile=False), Certificate(sequence.n, sequence.m)
    proxqp = ProxqpBackend(sequence.n, sequence.m)
    nothing = Reference(np.full(sequence.n, np.nan), np.inf, "", False)
    found = []
    for tick, qp in enumerate(sequence):
        best = nothing
        if not {"infeasible", "nan"} & {*sequence.marks_of(tick)}:
            spread = np.linalg.eigvalsh((qp.H + qp.H.T) / 2)
            unique = bool(spread[0] > UNIQUE * spread[-1])
            for name in ("qrqp", "proxqp"):
                answer = (
                    fused.parted(fused.solve(fused.flat(qp), warm=False)[0]) if name == "qrqp" else proxqp.solve(qp)
                )
                for claim in (answer, improved(qp, answer)):
                    residual = certificate.residual(qp, claim)
                    if residual < best.residual:
                        best = Reference(np.clip(claim.x, qp.lower, qp.upper), residual, name, unique)
                if best.residual <= ACCURACY:
                    break
        found.append(best)
    return tuple(found)


def improved(qp: Instance, answer: Answer) -> Answer:
    """The point that solves the optimality conditions of the answer's active set exactly, if that set is right."""
    n = qp.g.size
    stacked = np.vstack([np.eye(n), qp.A])
    multipliers = np.concatenate(answer[1:3])
    if not (np.isfinite(multipliers).all() and np.isfinite(answer.x).all()):
        return answer
    lower, upper = np.concatenate([qp.lower, qp.rows_lower]), np.concatenate([qp.upper, qp.rows_upper])
    # Below this a multiplier is what rounding leaves; equalities are active whatever their multiplier.
    active = (np.abs(multipliers) > 1e-9 * (1 + np.abs(multipliers).max(initial=0.0))) | (lower == upper)
    limits = np.where(multipliers > 0, upper, lower)[active]
    rows = stacked[active]
    k = len(rows)
    if not np.isfinite(limits).all():
        return answer
    matrix = np.block([[qp.H, rows.T], [rows, np.zeros((k, k))]])
    right = np.concatenate([-qp.g, limits])
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    solution = solution + np.linalg.lstsq(matrix, right - matrix @ solution, rcond=None)[0]
    exact = np.zeros(multipliers.size)
    exact[active] = solution[n:]
    return Answer(solution[:n], exact[:n], exact[n:], -1)
