"""What moves a base: which motions of the chassis its drive allows, and the wheel speeds that they take."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.real_array import is_finite, positive

__all__ = [
    "ChassisMotion",
    "Differential",
    "Drive",
    "Fixed",
    "Mecanum",
    "Omnidirectional",
    "checked_amounts",
    "checked_lengths",
]

Array = NDArray[np.float64]


class ChassisMotion(NamedTuple):
    """What wheel speeds make of a chassis that does not slip more than it must."""

    twist: Array
    """(3,) forward [m/s], left [m/s], turn [rad/s, counterclockwise from above] in the chassis frame."""
    slip: float
    """[m/s] root mean square, over the wheels, of rim speeds that no motion of the chassis explains."""


class Drive(ABC):
    """Constraints on the twist of a chassis (forward, left [m/s], turn [rad/s], in its own frame).

    `moving` says which of the three it allows, `rolling` which wheel speeds they take, `limit` how fast those may be.
    Controllers, plants, reports and the published controller take what they know of a drive from these. How fast and
    how hard the chassis itself may move are limits of the chain.
    """

    moving: ClassVar[tuple[int, ...]] = (0, 1, 2)
    """Of forward, left and turn, what the drive allows."""
    radius: float
    """[m] of the wheels: times their speed, the speed of their rims."""
    limit: float
    """Largest wheel speed [rad/s]; infinite where the limits of the chassis are all there is."""

    @property
    @abstractmethod
    def rolling(self) -> Array:
        """(w, 3) matrix from chassis twist to wheel speeds [rad/s]."""

    @abstractmethod
    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """The chassis motion of wheel speeds (w,) [rad/s], and how much they slip."""

    @classmethod
    def still(cls) -> list[int]:
        """Of forward, left and turn, what the drive does not allow."""
        return [i for i in range(3) if i not in cls.moving]

    @property
    def holonomic(self) -> bool:
        """Whether the chassis goes forward and to the left at once, so that its speed is bounded as a whole."""
        return {0, 1} <= set(self.moving)

    @property
    def rims(self) -> tuple[Array, Array]:
        """Rows (r, 3) from chassis twist to rim speeds, and their limits (r,) [m/s]; none where no wheel is limited."""
        rows = self.rolling if self.limit < math.inf else np.zeros((0, 3))
        return self.radius * rows, np.full(len(rows), self.radius * self.limit if len(rows) else 0.0)

    def wheel_speeds(self, twist: ArrayLike) -> Array:
        """(w,) wheel speeds [rad/s] of a chassis twist (3,): forward, left [m/s], turn [rad/s]."""
        return np.asarray(self.rolling @ per_joint("twist", twist, 3))

    def wheel_speeds_expression(self, twist: ca.SX) -> ca.SX:
        """(w,) expression of `wheel_speeds`."""
        return ca.sparsify(ca.DM(self.rolling)) @ twist

    @classmethod
    def constraints(cls, q: ArrayLike) -> Array:
        """(c, n) rows at joint values q (n,), of which the first three are the chassis' place and heading in the world.

        Times the joint velocities they are zero: minus the chassis speeds that the drive does not allow. Of two wheels
        on one axle that is the row of Eq. (4), Honzik.
        """
        joints = np.asarray(q, dtype=np.float64)
        cos, sin = np.cos(joints[2]), np.sin(joints[2])
        rows = np.zeros((3, joints.size))
        rows[0, :2], rows[1, :2], rows[2, 2] = (-cos, -sin), (sin, -cos), -1.0
        return rows[cls.still()]


class Omnidirectional(Drive):
    """A base that takes its own twist as command and goes in every direction at once; no wheels are known.

    Its "wheel speeds" are that twist: forward, left [m/s], turn [rad/s]. Bounds: the size of the velocity
    along the floor, the turn rate, and the accelerations forward, to the left and turning.
    """

    radius = 1.0
    limit = math.inf

    @property
    def rolling(self) -> Array:
        """(3, 3) of ones: the twist is the command."""
        return np.eye(3)

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """The twist that is commanded."""
        return ChassisMotion(per_joint("wheels", wheels, 3), 0.0)


class Fixed(Drive):
    """A base that stands: a table, a chair with its brakes on. There are no wheels to command."""

    moving: ClassVar[tuple[int, ...]] = ()
    radius = 1.0
    limit = math.inf

    @property
    def rolling(self) -> Array:
        """(0, 3): nothing rolls."""
        return np.zeros((0, 3))

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """Rest."""
        return ChassisMotion(np.zeros(3), 0.0)


@dataclass(frozen=True)
class Mecanum(Drive):
    """Mecanum wheels in the X arrangement: 1 front right, 2 front left, 3 rear left, 4 rear right.

    Eq. (2), Honzik, has x to the right and y forward, so its input is (-v_left, v_forward). Its a + b is half the gauge
    plus half the base: with the whole lengths, as the text names them, the chair turns twice as fast as commanded.
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


def checked_lengths(**numbers: float) -> None:
    """Refuse what is not a positive, finite number."""
    for name, number in numbers.items():
        positive(name, number)


def checked_amounts(**numbers: float) -> None:
    """Refuse what is not a finite number of zero or more."""
    for name, number in numbers.items():
        if not (is_finite(number) and number >= 0.0):
            raise ConfigurationError(name, number, "a finite number of zero or more")
