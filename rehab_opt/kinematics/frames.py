"""Rotations as expressions: what a pose error is."""

from __future__ import annotations

import casadi as ca

__all__ = ["is_rigid", "is_rotation", "rotation_vector"]

ROTATION_TOLERANCE = 1e-3
"""Norm of the six products of axes, less 0 or 1, in what is still a rotation: a measured one is rounded, no more."""


def rotation_vector(rotation: ca.SX) -> ca.SX:
    """(3,) axis times angle [rad], angle in [0, pi], of a rotation matrix (3, 3); accurate from 0 to pi.

    With c and s the cosine and sine of the angle, R - R' holds s times the axis, which fades towards pi, where
    (R + R')/2 - c I = (1 - c) axis axis' takes over.
    """
    r = rotation
    cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1)
    skew = 0.5 * ca.vertcat(r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1])
    sine = ca.norm_2(skew)
    angle = ca.atan2(sine, cosine)
    # The column with the largest diagonal is the best conditioned multiple of the axis.
    off = [0.5 * (r[1, 0] + r[0, 1]), 0.5 * (r[2, 0] + r[0, 2]), 0.5 * (r[2, 1] + r[1, 2])]
    columns = [
        ca.vertcat(r[0, 0] - cosine, off[0], off[1]),
        ca.vertcat(off[0], r[1, 1] - cosine, off[2]),
        ca.vertcat(off[1], off[2], r[2, 2] - cosine),
    ]
    first = ca.if_else(r[0, 0] >= r[1, 1], columns[0], columns[1])
    largest = ca.if_else(r[2, 2] > ca.fmax(r[0, 0], r[1, 1]), columns[2], first)
    along = ca.if_else(ca.dot(largest, skew) < 0, -1, 1)
    near_pi = cosine < -0.5
    direction, length = ca.if_else(near_pi, along * largest, skew), ca.if_else(near_pi, ca.norm_2(largest), sine)
    tiny = length < 1e-150
    return direction * ca.if_else(tiny, 1, angle / (length + tiny))


def is_rigid(pose: ca.SX) -> ca.SX:
    """1 where `pose` (4, 4) is a rotation with a translation beside and (0, 0, 0, 1) below, to `ROTATION_TOLERANCE`."""
    below = ca.sumsqr(pose[3, :] - ca.DM([[0, 0, 0, 1]])) <= ROTATION_TOLERANCE**2
    return ca.logic_and(is_rotation(pose[:3, :3]), below)


def is_rotation(matrix: ca.SX) -> ca.SX:
    """1 where `matrix` (3, 3) is a rotation to `ROTATION_TOLERANCE`; not for a mirrored or a NaN one."""
    x, y, z = (matrix[:, i] for i in range(3))
    excess = [ca.dot(axis, axis) - 1 for axis in (x, y, z)] + [ca.dot(x, y), ca.dot(y, z), ca.dot(z, x)]
    right_handed = ca.dot(ca.cross(x, y), z) > 0
    return ca.logic_and(ca.sumsqr(ca.vertcat(*excess)) <= ROTATION_TOLERANCE**2, right_handed)
