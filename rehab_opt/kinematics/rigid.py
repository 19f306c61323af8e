"""Rigid transforms: check them, correct rounded ones, and build their expressions."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array

__all__ = [
    "EXACT", "ROUNDED", "inverse_pose", "is_rigid", "is_rotation", "nearest_rigid", "rigid", "rotation_vector",
]  # fmt: skip

Array = NDArray[np.float64]

EXACT = 1e-9
"""Tolerance of an exact transform, for the entries of R R^T - I and for unit lengths."""
ROUNDED = 1e-3
"""The same tolerance for a transform whose numbers were rounded."""
ROTATION_TOLERANCE = 1e-3
"""Tolerance of a measured rotation, for the norm of the errors in the six dot products of its axes."""


def rigid(argument: str, value: ArrayLike) -> Array:
    """`value` as a read-only rigid transform (4, 4).

    Raises
    ------
    ConfigurationError : the transform is not rigid to 1e-9; the message states its error if it is small.
    """
    pose, off = _pose(argument, value)
    if not off <= EXACT:
        raise ConfigurationError(argument, value, f"a (4, 4) rigid transform; its axes are off by {off:.2g}")
    return pose


def nearest_rigid(argument: str, value: ArrayLike) -> tuple[Array, str]:
    """Two results: the read-only rigid transform (4, 4) nearest to `value`, and a note if that corrected rounding.

    Raises
    ------
    ConfigurationError : the rotation is off by more than `ROUNDED`.
    """
    pose, off = _pose(argument, value)
    if off <= EXACT:
        return pose, ""
    if not off <= ROUNDED:
        raise ConfigurationError(argument, value, f"a (4, 4) rigid transform; its axes are off by {off:.2g}")
    left, _, right = np.linalg.svd(pose[:3, :3])
    nearest = pose.copy()
    nearest[:3, :3] = left @ right  # the rotation with the least squared difference
    nearest.flags.writeable = False
    return nearest, f"{argument}: the rotation is off by {off:.2g}, as rounded numbers are; the nearest one is used"


def inverse_pose(pose: Array) -> Array:
    """(4, 4) inverse of a rigid transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def _pose(argument: str, value: ArrayLike) -> tuple[Array, float]:
    """Two results: `value` as a read-only, right-handed (4, 4) array, and the largest entry of R R^T - I."""
    expected = "a (4, 4) rigid transform"
    pose = np.array(checked_array(argument, value, expected))
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)) or not np.array_equal(pose[3], (0, 0, 0, 1)):
        raise ConfigurationError(argument, value, expected)
    rotation = pose[:3, :3]
    if not np.linalg.det(rotation) > 0:
        raise ConfigurationError(argument, value, expected)
    pose.flags.writeable = False
    return pose, float(np.abs(rotation @ rotation.T - np.eye(3)).max())


def rotation_vector(rotation: ca.SX) -> ca.SX:
    """(3,) axis times angle [rad], angle in [0, pi], of a rotation matrix (3, 3); accurate on all of [0, pi].

    Let c and s be cosine and sine of the angle. R - R^T gives s times the axis, which vanishes near pi. There the axis
    comes from (R + R^T)/2 - c I = (1 - c) axis axis^T.
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
    """1 if `pose` (4, 4) is a rigid transform to `ROTATION_TOLERANCE`, else 0."""
    below = ca.sumsqr(pose[3, :] - ca.DM([[0, 0, 0, 1]])) <= ROTATION_TOLERANCE**2
    return ca.logic_and(is_rotation(pose[:3, :3]), below)


def is_rotation(matrix: ca.SX) -> ca.SX:
    """1 if `matrix` (3, 3) is a rotation to `ROTATION_TOLERANCE`; 0 for mirrored matrices and NaN."""
    x, y, z = (matrix[:, i] for i in range(3))
    excess = [ca.dot(axis, axis) - 1 for axis in (x, y, z)] + [ca.dot(x, y), ca.dot(y, z), ca.dot(z, x)]
    right_handed = ca.dot(ca.cross(x, y), z) > 0
    return ca.logic_and(ca.sumsqr(ca.vertcat(*excess)) <= ROTATION_TOLERANCE**2, right_handed)
