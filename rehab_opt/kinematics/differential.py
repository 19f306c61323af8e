"""Two driven wheels on one axle: the ordinary wheelchair, which cannot move sideways. Eq. (4), Honzik."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.drive import ChassisMotion, Drive
from rehab_opt.kinematics.mecanum import checked_lengths

__all__ = ["Differential"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Differential(Drive):
    """Driven wheels 1 right and 2 left, beside the chassis' origin; castors follow. Positive rolls forward.

    Parameters
    ----------
    radius : of the wheels [m].
    half_gauge : [m] half the distance between the wheels.
    limit : largest wheel speed [rad/s].

    Raises
    ------
    ConfigurationError : a number that is not positive and finite.
    """

    moving: ClassVar[tuple[int, ...]] = (0, 2)
    radius: float
    half_gauge: float
    limit: float

    def __post_init__(self) -> None:
        """Check every number."""
        checked_lengths(radius=self.radius, half_gauge=self.half_gauge, limit=self.limit)

    @property
    def rolling(self) -> Array:
        """(2, 3) matrix from chassis twist (forward, left, turn) to wheel speeds [rad/s]; left is not seen by it."""
        return np.array([[1.0, 0.0, self.half_gauge], [1.0, 0.0, -self.half_gauge]]) / self.radius

    def slip(self, twist: ArrayLike) -> float:
        """[m/s] sideways speed, positive to the left, which rolling wheels do not allow: minus the row of Eq. (4)."""
        return float(per_joint("twist", twist, 3)[1])

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """The chassis motion of wheel speeds (2,) [rad/s]; two wheels turned by hand never slip."""
        right, left = self.radius * per_joint("wheels", wheels, 2)
        return ChassisMotion(np.array([(right + left) / 2, 0.0, (right - left) / (2 * self.half_gauge)]), 0.0)
