"""The answers that others are compared with, against rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.qp_recording.sequence import read_sequence
from bench.solvers.reference import references
from bench.solvers.shipped import shipped_sequences
from rehab_opt.optim.rows import Instance

Array = NDArray[np.float64]
AT_BOUND = 1e-15


def rational_answer(qp: Instance, near: Array) -> Array:
    """The minimum, exact: the conditions of the bounds that `near` is at, solved and checked in fractions."""
    n = qp.g.size
    stacked = np.vstack([np.eye(n), qp.A])
    lower, upper = np.concatenate([qp.lower, qp.rows_lower]), np.concatenate([qp.upper, qp.rows_upper])
    values = stacked @ near
    side = np.where(np.abs(values - upper) <= AT_BOUND, 1, np.where(np.abs(values - lower) <= AT_BOUND, -1, 0))
    rows = stacked[side != 0]
    limits = np.where(side > 0, upper, lower)[side != 0]
    k = len(rows)
    matrix = np.block([[qp.H, rows.T], [rows, np.zeros((k, k))]])
    solution = solved([[Fraction(v) for v in row] for row in matrix.tolist()],
                      [Fraction(v) for v in np.concatenate([-qp.g, limits]).tolist()])  # fmt: skip
    x, multipliers = solution[:n], solution[n:]
    assert all(y * int(s) >= 0 for y, s in zip(multipliers, side[side != 0], strict=True))
    for row, low, high in zip(stacked.tolist(), lower, upper, strict=True):
        value = sum((Fraction(a) * v for a, v in zip(row, x, strict=True)), Fraction(0))
        assert not (np.isfinite(low) and value < Fraction(low))
        assert not (np.isfinite(high) and value > Fraction(high))
    return np.array([float(v) for v in x])


def solved(matrix: list[list[Fraction]], right: list[Fraction]) -> list[Fraction]:
    """Gauss and Jordan."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for i in range(len(rows)):
        pivot = next(j for j in range(i, len(rows)) if rows[j][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for j in range(len(rows)):
            if j != i and rows[j][i]:
                factor = rows[j][i]
                rows[j] = [a - factor * b for a, b in zip(rows[j], rows[i], strict=True)]
    return [row[-1] for row in rows]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["mirror/late", "pose_tracking/free", "mirror/near_singularity"])
def test_a_reference_is_exact_also_where_the_hessian_is_nearly_singular(name: str) -> None:
    """H's smallest eigenvalue is 1e-8 of its largest: a residual of 1e-16 leaves an answer 5e-9 from the exact one."""
    sequence = read_sequence(shipped_sequences()[name]).first(80)
    for tick, known in list(enumerate(references(sequence)))[::5]:
        assert known.residual <= 1e-10
        exact = rational_answer(sequence[tick], known.x)
        assert np.linalg.norm(known.x - exact) <= 1e-12
