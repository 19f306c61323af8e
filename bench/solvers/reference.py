"""The answer that others are compared with, and how well it is known."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.sequence import QPSequence
from bench.solvers.dense_qp import Certificate, DenseQP, fits
from rehab_opt.optim.backends import Answer, ProxqpBackend
from rehab_opt.optim.rows import Instance

__all__ = ["ACCURACY", "Reference", "references"]

Array = NDArray[np.float64]

ACCURACY = 1e-10
"""Residual that a reference is solved to, absolute, in the statement's units."""
CORRECTIONS = 10
"""Of an active set."""
ROUNDING = 1e-15
"""By which a bound may be broken, or pull."""
REFINEMENTS = 5
"""Of a solve on an active set: each gains what the condition leaves of a double's 16 digits."""
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
    """For every tick: the exact answer on the active set of qrqp cold, or of proxqp; their own where that is no better.

    The first that is certified to `ACCURACY` counts, the exact one before the solver's: a Hessian that is nearly
    singular hides in the residual what an answer is away from the exact one.
    """
    n, m = sequence.n, sequence.m
    fused, certificate = DenseQP(n, m, compile=False) if fits(n, m) else None, Certificate(n, m)
    proxqp = ProxqpBackend(n, m)
    nothing = Reference(np.full(sequence.n, np.nan), np.inf, "", False)
    found = []
    for tick, qp in enumerate(sequence):
        best = nothing
        if not {"infeasible", "nan"} & {*sequence.marks_of(tick)}:
            spread = np.linalg.eigvalsh((qp.H + qp.H.T) / 2)
            unique = bool(spread[0] > UNIQUE * spread[-1])
            for name, claim in _claims(qp, fused, proxqp):
                residual = certificate.residual(qp, claim)
                if residual < best.residual:
                    best = Reference(np.clip(claim.x, qp.lower, qp.upper), residual, name, unique)
                if best.residual <= ACCURACY:
                    break
        found.append(best)
    return tuple(found)


def _claims(qp: Instance, fused: DenseQP | None, proxqp: ProxqpBackend) -> Iterator[tuple[str, Answer]]:
    """Who claims what, in the order in which it is believed."""
    if fused is not None:
        answer = fused.parted(fused.solve(fused.flat(qp), warm=False)[0])
        yield "qrqp", improved(qp, answer)
        yield "qrqp", answer
    answer = proxqp.solve(qp)
    yield "proxqp", improved(qp, answer)
    yield "proxqp", answer


def improved(qp: Instance, answer: Answer) -> Answer:
    """The exact answer, where the answer's active set is right or a few bounds away from it; else no better.

    It solves the optimality conditions of the active set; a bound that is broken joins it, one that pulls leaves it.
    What is left of the conditions is computed in extended precision, so that the point is exact to its last digits
    where double precision loses half of them to the condition of H.
    """
    n = qp.g.size
    stacked = np.vstack([np.eye(n), qp.A])
    multipliers = np.concatenate(answer[1:3])
    if not (np.isfinite(multipliers).all() and np.isfinite(answer.x).all()):
        return answer
    lower, upper = np.concatenate([qp.lower, qp.rows_lower]), np.concatenate([qp.upper, qp.rows_upper])
    # Below this a multiplier is what rounding leaves; equalities are active whatever their multiplier.
    side = np.sign(multipliers) * (np.abs(multipliers) > 1e-9 * (1 + np.abs(multipliers).max(initial=0.0)))
    side[(side == 0) & (lower == upper)] = 1
    for _ in range(CORRECTIONS):
        limits = np.where(side > 0, upper, lower)[side != 0]
        if not np.isfinite(limits).all():
            return answer
        x, exact = np.split(_solved(qp, stacked[side != 0], limits), [n])
        values = stacked.astype(np.longdouble) @ x
        beyond = np.where(side == 0, np.maximum(values - upper, lower - values), 0)
        pulling = np.zeros(side.size, dtype=np.longdouble)
        pulling[side != 0] = -exact * side[side != 0]
        pulling[lower == upper] = 0
        if beyond.max(initial=0.0) > ROUNDING:
            joins = int(np.argmax(beyond))
            side[joins] = 1 if values[joins] > upper[joins] else -1
        elif pulling.max(initial=0.0) > ROUNDING:
            side[int(np.argmax(pulling))] = 0
        else:
            found = np.zeros(multipliers.size)
            found[side != 0] = exact
            return Answer(x.astype(np.float64), found[:n], found[n:], -1)
    return answer


def _solved(qp: Instance, rows: Array, limits: Array) -> NDArray[np.longdouble]:
    """(n + k,) x and multipliers with H x + rows' y = -g, rows x = limits."""
    k = len(rows)
    matrix, right = np.block([[qp.H, rows.T], [rows, np.zeros((k, k))]]), np.concatenate([-qp.g, limits])
    extended, solution = matrix.astype(np.longdouble), np.zeros(right.size, dtype=np.longdouble)
    inverse = np.linalg.pinv(matrix)
    for _ in range(REFINEMENTS):
        solution = solution + inverse @ (right - extended @ solution).astype(np.float64)
    return solution
