"""Rotations as expressions: what a pose error is."""

from __future__ import annotations

import casadi as ca

__all__ = ["is_rotation", "rotation_vector"]

ROTATION_TOLERANCE = 1e-3
"""Largest entry of R R' - I in what is still taken for a rotation: a measured one is rounded, a broken one is not."""


def rotation_vector(rotation: ca.SX) -> ca.SX:
    """(3,) axis times angle [rad], angle in [0, pi], of a rotation matrix (3, 3).

    Through the quaternion, from whichever of its entries is largest, so that it holds at 0 and at pi.
    """
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    # Four ways to 4 w_i (w, x, y, z); each is exact, and accurate where its leading entry is large.
    ways = [
        (trace, [1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]),
        (r[0, 0], [r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]]),
        (r[1, 1], [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]]),
        (r[2, 2], [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace]),
    ]
    largest, chosen = ways[0][0], ca.vertcat(*ways[0][1])
    for measure, entries in ways[1:]:
        better = measure > largest
        largest, chosen = ca.if_else(better, measure, largest), ca.if_else(better, ca.vertcat(*entries), chosen)
    # A quaternion and its negative are one rotation; w >= 0 is the one with an angle up to pi.
    w, v = chosen[0], ca.if_else(chosen[0] < 0, -chosen[1:], chosen[1:])
    length = ca.norm_2(v)
    tiny = length < 1e-12 * ca.norm_2(chosen)
    return v * ca.if_else(tiny, 2 / ca.fabs(w), 2 * ca.atan2(length, ca.fabs(w)) / ca.if_else(tiny, 1, length))


def is_rotation(matrix: ca.SX) -> ca.SX:
    """1 where `matrix` (3, 3) is a rotation to `ROTATION_TOLERANCE`; not for a mirrored or a NaN one."""
    excess = matrix @ matrix.T - ca.SX.eye(3)
    right_handed = ca.dot(ca.cross(matrix[:, 0], matrix[:, 1]), matrix[:, 2])
    return ca.logic_and(ca.sumsqr(excess) <= ROTATION_TOLERANCE**2, right_handed > 0)
