"""Solutions of small symmetric systems as expressions."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

__all__ = ["solver_of"]


def solver_of(matrix: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """Right-hand sides (n, k) -> solutions (n, k) for a symmetric, positive definite matrix (n, n).

    Not finite where it is none: who calls certifies what comes out.
    """
    diagonal, factor, order = ca.ldl(ca.densify(matrix), False)

    def solve(right: ca.SX) -> ca.SX:
        columns = [ca.ldl_solve(ca.densify(right[:, i]), diagonal, factor, order) for i in range(right.size2())]
        return ca.horzcat(*columns)

    return solve
