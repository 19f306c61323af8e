"""What of an asked twist a chain can deliver at its present pose, at whatever speed."""

from __future__ import annotations

import casadi as ca

__all__ = ["deliverable_twist"]

DAMPING = 4e-4
"""Square of the singular value [m/rad or 1] below which a direction counts as lost."""
PASSES = 3
"""Passes of the damped solve: each removes the damping's error where the arm is far from singular."""


def deliverable_twist(jacobian: ca.SX, twist: ca.SX, lower: ca.SX, upper: ca.SX) -> ca.SX:
    """(k,) the part of `twist` that joint velocities within [lower, upper] can produce.

    Directions lost to a singular pose are left out, smoothly, and joints that would leave their interval are held at
    its end while the others make up for them. Without this, keeping the direction of an undeliverable twist would
    stop the arm, where going on to the nearest pose is wanted.

    Parameters
    ----------
    jacobian : (k, n). twist : (k,).
    lower, upper : (n,) velocities from which the joints can still stop at their position limits.
    """
    wanted = _joint_velocity(jacobian, twist)
    held = ca.if_else(wanted > upper, upper, ca.if_else(wanted < lower, lower, 0))
    free = ca.logic_and(wanted <= upper, wanted >= lower)
    forced = jacobian @ held
    others = jacobian @ ca.diag(free)
    return forced + others @ _joint_velocity(others, twist - forced)


def _joint_velocity(jacobian: ca.SX, twist: ca.SX) -> ca.SX:
    """Iterated damped least squares: J'(K^-1 + d K^-2 + d^2 K^-3) v with K = J J' + d I."""
    k = jacobian.size1()
    diagonal, factor, order = ca.ldl(ca.densify(jacobian @ jacobian.T) + DAMPING * ca.SX.eye(k), False)
    remaining, total = twist, ca.SX.zeros(k)
    for _ in range(PASSES):
        solved = ca.ldl_solve(remaining, diagonal, factor, order)
        total += solved
        remaining = DAMPING * solved
    return jacobian.T @ total
