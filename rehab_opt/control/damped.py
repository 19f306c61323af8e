"""Joint velocities for a twist by damped least squares."""

from __future__ import annotations

import casadi as ca

__all__ = ["DAMPING", "PASSES", "damped_velocity"]

DAMPING = 4e-4
"""Squared singular value [m/rad or 1] below which a direction counts as singular."""
PASSES = 3
"""Number of passes; each reduces the damping's error far from singular postures."""


def damped_velocity(
    jacobian: ca.SX,
    twist: ca.SX,
    *,
    drift: ca.SX | None = None,
    damping: ca.SX | float = DAMPING,
    passes: int = PASSES,
) -> ca.SX:
    """Joint velocities (n,) J'(K^-1 + d K^-2 + ...) v with K = J J' + d I, by iterated damped least squares.

    J is the Jacobian, v the twist, d the damping. If joint velocities `drift` (n,) are given, their component that does
    not move the hand is added.
    """
    k = jacobian.size1()
    diagonal, factor, order = ca.ldl(ca.densify(jacobian @ jacobian.T) + damping * ca.SX.eye(k), False)
    remaining, total = twist if drift is None else twist - jacobian @ drift, ca.SX.zeros(k)
    for _ in range(passes):
        solved = ca.ldl_solve(ca.densify(remaining), diagonal, factor, order)
        total += solved
        remaining = damping * solved
    return ca.densify(jacobian.T @ total if drift is None else drift + jacobian.T @ total)
