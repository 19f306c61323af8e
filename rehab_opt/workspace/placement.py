"""Placement of a shoulder in the frame of a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["ShoulderPlacement"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShoulderPlacement:
    """Pose of the shoulder's frame in the robot's frame; both have z up. `human_arm(side=...)` sets the side.

    Parameters
    ----------
    position : (3,) [m] of the shoulder in the robot's frame.
    turn : [rad] of the shoulder's axes about the vertical, counterclockwise from above.

    Raises
    ------
    ConfigurationError : numbers that are not finite, or not three.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: float = 0.0

    def __post_init__(self) -> None:
        try:
            numbers = np.asarray(self.position)
            position = tuple(map(float, numbers.tolist())) if numbers.dtype.kind in "fiu" else ()
        except (TypeError, ValueError, OverflowError):
            position = ()
        if len(position) != 3 or not all(map(math.isfinite, position)):
            raise ConfigurationError("position", self.position, "three finite numbers, in metres")
        try:
            turn = math.nan if isinstance(self.turn, str | bytes) else float(self.turn)
        except (TypeError, ValueError, OverflowError):
            turn = math.nan
        if not math.isfinite(turn):
            raise ConfigurationError("turn", self.turn, "a finite angle in radians")
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "turn", turn)

    @property
    def rotation(self) -> Array:
        """(2, 2) rotation from the shoulder's axes to the robot's."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        return np.array([[c, -s], [s, c]])

    @property
    def pose(self) -> Array:
        """(4, 4) pose of the shoulder in the robot's frame."""
        pose = np.eye(4)
        pose[:2, :2] = self.rotation
        pose[:3, 3] = self.position
        return pose

    def to_robot(self, points: ArrayLike) -> Array:
        """Transform points (..., 2) [m] from the shoulder's frame to the robot's."""
        return np.asarray(_planar(points) @ self.rotation.T + self.position[:2])

    def to_shoulder(self, points: ArrayLike) -> Array:
        """Transform points (..., 2) [m] from the robot's frame to the shoulder's."""
        return np.asarray((_planar(points) - self.position[:2]) @ self.rotation)


def _planar(points: ArrayLike) -> Array:
    expected = "points (..., 2), numbers in metres"
    try:
        array = np.asarray(points)
    except (TypeError, ValueError, OverflowError) as problem:  # ragged
        raise ConfigurationError("points", points, expected) from problem
    if array.dtype.kind not in "fiu" or array.ndim == 0 or array.shape[-1] != 2:
        raise ConfigurationError("points", points, expected)
    return array.astype(np.float64, copy=False)
