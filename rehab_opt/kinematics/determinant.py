"""The determinant of a matrix of expressions."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

__all__ = ["determinant"]


def determinant(matrix: ca.SX) -> ca.SX:
    """Determinant as an expression with no division, so that its derivatives hold at singular matrices too."""
    columns = [[matrix[i, j] for i in range(matrix.size1())] for j in range(matrix.size2())]
    minors: dict[tuple[int, ...], ca.SX] = {(): ca.SX(1)}
    for column in columns:  # minors of the first k columns, by rows taken: expansion along the newest column
        minors = _extended(minors, column)
    return minors[tuple(range(len(columns)))]


def _extended(minors: dict[tuple[int, ...], ca.SX], column: Sequence[ca.SX]) -> dict[tuple[int, ...], ca.SX]:
    wider: dict[tuple[int, ...], ca.SX] = {}
    for rows, minor in minors.items():
        for i, entry in enumerate(column):
            if i in rows:
                continue
            taken = tuple(sorted((*rows, i)))
            sign = (-1) ** (len(rows) - taken.index(i))
            wider[taken] = wider.get(taken, ca.SX(0)) + sign * entry * minor
    return wider
