"""Four mecanum wheels: chassis motion to wheel speeds and back. Eq. (2), Honzik."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.drive import ChassisMotion, Drive
from rehab_opt.kinematics.real_array import is_finite, positive

__all__ = ["Mecanum", "checked_amounts", "checked_lengths"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mecanum(Drive):
    """Mecanum wheels in the X arrangement: 1 front right, 2 front left, 3 rear left, 4 rear right.

    Eq. (2) has x to the right and y forward, so that it is fed (-v_left, v_forward); and its a + b is half the gauge
    plus half the base: with the whole lengths, as the text names them, the chair would turn at half the speed asked.
    A positive speed rolls the wheel forward.

    Parameters
    ----------
    radius : of the wheels [m].
    half_gauge, half_base : [m] half the distance between left and right wheels, and between front and rear axles.
    limit : largest wheel speed [rad/s].

    Raises
    ------
    ConfigurationError : a number that is not positive and finite.
    """

    radius: float
    half_gauge: float
    half_base: float
    limit: float

    def __post_init__(self) -> None:
        """Check every number."""
        checked_lengths(radius=self.radius, half_gauge=self.half_gauge, half_base=self.half_base, limit=self.limit)

    @property
    def rolling(self) -> Array:
        """(4, 3) matrix from chassis twist (forward, left, turn) to wheel speeds [rad/s]."""
        arm = self.half_gauge + self.half_base
        eq2 = np.array([[-1, 1, arm], [1, 1, -arm], [-1, 1, -arm], [1, 1, arm]]) / self.radius
        from_chassis = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
        return np.asarray(eq2 @ from_chassis, dtype=np.float64)

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """The chassis motion nearest to wheel speeds (4,) [rad/s], and how much they slip."""
        speeds = per_joint("wheels", wheels, 4)
        twist = np.linalg.pinv(self.rolling) @ speeds
        off = self.radius * (speeds - self.rolling @ twist)
        return ChassisMotion(twist, float(np.sqrt(np.mean(off * off))))


def checked_lengths(**numbers: float) -> None:
    """Refuse what is not a positive, finite number."""
    for name, number in numbers.items():
        positive(name, number)


def checked_amounts(**numbers: float) -> None:
    """Refuse what is not a finite number of zero or more."""
    for name, number in numbers.items():
        if not (is_finite(number) and number >= 0.0):
            raise ConfigurationError(name, number, "a finite number of zero or more")
