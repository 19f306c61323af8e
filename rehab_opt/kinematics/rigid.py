"""Rigid transforms as a caller writes them down: checked, and turned to the nearest one where they are rounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["EXACT", "ROUNDED", "inverse_pose", "nearest_rigid", "rigid"]

Array = NDArray[np.float64]

EXACT = 1e-9
"""Largest entry of R R' - I of what is a rotation as it is, and largest error of a length that is 1: a nanometre."""
ROUNDED = 1e-3
"""Largest entry of R R' - I, and largest error of a length that should be 1, that rounding can explain."""


def rigid(argument: str, value: ArrayLike) -> Array:
    """`value` as a read-only rigid transform (4, 4).

    Raises
    ------
    ConfigurationError : it is none to 1e-9; where it is nearly one, the error says how far it is off.
    """
    pose, off = _pose(argument, value)
    if not off <= EXACT:
        raise ConfigurationError(argument, value, f"a (4, 4) rigid transform; its axes are off by {off:.2g}")
    return pose


def nearest_rigid(argument: str, value: ArrayLike) -> tuple[Array, str]:
    """`value` as a read-only rigid transform (4, 4), and a note where rounded numbers had to be corrected.

    Raises
    ------
    ConfigurationError : it is off by more than `ROUNDED`.
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
    """`value` as a read-only (4, 4) that is no mirror image, and the largest entry of R R' - I."""
    expected = "a (4, 4) rigid transform"
    pose = np.array(checked_array(argument, value, expected))
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)) or not np.array_equal(pose[3], (0, 0, 0, 1)):
        raise ConfigurationError(argument, value, expected)
    rotation = pose[:3, :3]
    if not np.linalg.det(rotation) > 0:
        raise ConfigurationError(argument, value, expected)
    pose.flags.writeable = False
    return pose, float(np.abs(rotation @ rotation.T - np.eye(3)).max())
