"""Small matrices as expressions: determinants, solutions of symmetric systems, and upper triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

__all__ = ["determinant", "solver_of", "symmetric", "triangle", "upper_triangle"]


def determinant(matrix: ca.SX) -> ca.SX:
    """Determinant without division, so that its derivatives are valid at singular matrices, too."""
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


def solver_of(matrix: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Function (right-hand sides (n, k)) -> solutions (n, k), for a symmetric, positive definite matrix (n, n).

    For another matrix the result is not finite: the caller must certify it.
    """
    diagonal, factor, order = ca.ldl(ca.densify(matrix), False)

    def solve(right: ca.SX) -> ca.SX:
        columns = [ca.ldl_solve(ca.densify(right[:, i]), diagonal, factor, order) for i in range(right.size2())]
        return ca.horzcat(ca.SX(right.size1(), 0), *columns)

    return solve


def triangle(n: int) -> int:
    """Number of entries of the upper triangle of a matrix (n, n)."""
    return n * (n + 1) // 2


def upper_triangle(matrix: ca.SX) -> ca.SX:
    """Upper triangle of a symmetric matrix as a column."""
    n = matrix.size1()
    return ca.vertcat(*(matrix[i, j] for j in range(n) for i in range(j + 1)))


def symmetric(column: ca.SX, n: int) -> ca.SX:
    """Symmetric matrix (n, n) from its upper triangle as a column."""
    matrix, entries = ca.SX(n, n), iter(range(triangle(n)))
    for j in range(n):
        for i in range(j + 1):
            matrix[i, j] = matrix[j, i] = column[next(entries)]
    return matrix
