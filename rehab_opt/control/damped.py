"""Joint velocities for a twist by damped least squares, and the damping for a target out of reach.

A twist v removes an error e at the rate g, v = g e. A Gauss-Newton step assumes a constant Jacobian. But along a motion
d it changes by J' d, and where a joint limit or a stretched arm leaves a residual r = v - J q' of the twist, that takes
-r . J' d / g off the error's descent, as damping does. Without it every step is too long, and the joints oscillate
about the nearest posture at up to 2 rad/s while the hand hardly moves. Sugihara (IEEE T-RO 27(5), 2011) damps by the
squared error, also where targets are within reach.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from rehab_opt.optim.certificate import clipped

__all__ = ["DAMPING", "PASSES", "Bend", "bent_velocity", "damped_velocity"]

DAMPING = 4e-4
"""Square of the singular value [m/rad or 1] below which a direction counts as lost."""
PASSES = 3
"""Passes of the damped solve: each removes the damping's error where the arm is far from singular."""
INSIDE = 1e-9
"""[rad/s] A joint this near to a speed that it must not pass is held."""
TINY = 1e-12
"""[rad/s] A motion that has no direction."""

Bend = Callable[[ca.SX], ca.SX]
"""Direction d (n,) -> (k,) J' d / g."""


def damped_velocity(jacobian: ca.SX, twist: ca.SX, drift: ca.SX, damping: ca.SX | float = DAMPING) -> ca.SX:
    """(n,) iterated damped least squares: J'(K^-1 + d K^-2 + d^2 K^-3) v with K = J J' + d I.

    `drift` (n,) is added where it does not move the hand: a posture, for redundant chains.
    """
    k = jacobian.size1()
    diagonal, factor, order = ca.ldl(ca.densify(jacobian @ jacobian.T) + damping * ca.SX.eye(k), False)
    remaining, total = twist - jacobian @ drift, ca.SX.zeros(k)
    for _ in range(PASSES):
        solved = ca.ldl_solve(remaining, diagonal, factor, order)
        total += solved
        remaining = damping * solved
    return ca.densify(drift + jacobian.T @ total)


def bent_velocity(
    jacobian: ca.SX,
    twist: ca.SX,
    left: ca.SX,
    *,
    velocity: ca.SX,
    others: Sequence[ca.SX],
    within: tuple[ca.SX, ca.SX],
    drift: ca.SX,
    movable: ca.DM,
    bend: Bend,
) -> ca.SX:
    """(n,) velocities for a twist (k,) of which `velocity` (n,) leaves some, damped by the hand's curvature, too.

    Directions are those of this and of `others`, as the last velocity: nearly there, the one is turned to and fro, and
    the other swings. Joints at their stopping speeds, the ends of `within`, are held. Each pass takes the damping off
    again, so there is PASSES times as much.
    """
    low, high = within
    curvature = ca.SX(0)
    for each in (velocity, *others):
        curvature = ca.fmax(curvature, -ca.dot(left, bend(each / ca.fmax(ca.norm_2(each), TINY))))
    free = ca.logic_and(velocity > low + INSIDE, velocity < high - INSIDE)
    held = velocity * ca.logic_not(free)
    moving = jacobian @ movable @ ca.diag(free)
    calm = damped_velocity(moving, twist - jacobian @ held, free * drift, DAMPING + PASSES * curvature)
    return clipped(held + free * calm, low, high)
