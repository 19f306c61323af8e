"""Columns of trace.csv that several systems have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["joint_columns", "point_columns"]

Array = NDArray[np.float64]


def point_columns(name: str, points: Array) -> Iterator[tuple[str, Array]]:
    """Points (N, 2) or (N, 3) [m]."""
    for axis, column in zip("xyz", points.T, strict=False):
        yield f"{name}_{axis}_m", column


def joint_columns(name: str, chain: SerialChain, values: Array, unit: str) -> Iterator[tuple[str, Array]]:
    """Values (N, n), one for each joint of the chain."""
    for joint, column in zip(chain.names, values.T, strict=True):
        yield f"{name}_{joint}_{unit}", column
