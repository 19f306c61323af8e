"""Drives of a mobile base: the chassis motions that they allow, and the wheel speeds of these motions."""

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
    """Chassis motion that fits measured wheel speeds with the least slip."""

    twist: Array
    """(3,) forward [m/s], left [m/s], turn [rad/s, counterclockwise from above] in the chassis frame."""
    slip: float
    """[m/s] root mean square, over the wheels, of the rim speeds that `twist` does not explain."""


class Drive(ABC):
    """A drive's constraints on the chassis twist in the chassis frame: forward [m/s], left [m/s], turn [rad/s].

    `moving` lists the components that the drive allows, `rolling` maps the twist to wheel speeds, and `limit` bounds
    these. Velocity and acceleration limits of the chassis itself belong to the chain.
    """

    moving: ClassVar[tuple[int, ...]] = (0, 1, 2)
    """Indices of the components (forward, left, turn) that the drive allows."""
    radius: float
    """[m] wheel radius; wheel speed times radius is the rim speed."""
    limit: float
    """Largest wheel speed [rad/s]; infinite if only the chassis is limited."""

    @property
    @abstractmethod
    def rolling(self) -> Array:
        """(w, 3) matrix from chassis twist to wheel speeds [rad/s]."""

    @abstractmethod
    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """Chassis motion and slip for wheel speeds (w,) [rad/s]."""

    @classmethod
    def still(cls) -> list[int]:
        """Indices of the components (forward, left, turn) that the drive does not allow."""
        return [i for i in range(3) if i not in cls.moving]

    @property
    def holonomic(self) -> bool:
        """Whether the drive allows forward and left motion at once; then the norm of the two speeds is bounded."""
        return {0, 1} <= set(self.moving)

    @property
    def rims(self) -> tuple[Array, Array]:
        """Two results: matrix (r, 3) from chassis twist to rim speeds, and limits (r,) [m/s] of the rim speeds.

        Without a limit of the wheels, r is 0.
        """
        rows = self.rolling if self.limit < math.inf else np.zeros((0, 3))
        return self.radius * rows, np.full(len(rows), self.radius * self.limit if len(rows) else 0.0)

    def wheel_speeds(self, twist: ArrayLike) -> Array:
        """(w,) [rad/s] wheel speeds for a chassis twist (3,): forward [m/s], left [m/s], turn [rad/s]."""
        return np.asarray(self.rolling @ per_joint("twist", twist, 3))

    def wheel_speeds_expression(self, twist: ca.SX) -> ca.SX:
        """(w,) expression of `wheel_speeds`."""
        return ca.sparsify(ca.DM(self.rolling)) @ twist

    @classmethod
    def constraints(cls, q: ArrayLike) -> Array:
        """(c, n) constraint matrix at joint values q (n,); q[:3] are position and heading of the chassis in the world.

        Times the joint velocities it gives minus the chassis speeds that the drive does not allow, which must be zero.
        For two wheels on one axle the matrix is the row of Eq. (4), Honzik.
        """
        joints = np.asarray(q, dtype=np.float64)
        cos, sin = np.cos(joints[2]), np.sin(joints[2])
        rows = np.zeros((3, joints.size))
        rows[0, :2], rows[1, :2], rows[2, 2] = (-cos, -sin), (sin, -cos), -1.0
        return rows[cls.still()]


class Omnidirectional(Drive):
    """A base that moves in every direction and takes its twist as the command; its wheels are not modelled.

    The "wheel speeds" of this base are the twist: forward [m/s], left [m/s], turn [rad/s]. Bounds apply to the speed
    along the floor, the turn rate, and the three accelerations.
    """

    radius = 1.0
    limit = math.inf

    @property
    def rolling(self) -> Array:
        """(3, 3) identity: the twist is the command."""
        return np.eye(3)

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """The wheel speeds of this base are its twist, so the slip is zero."""
        return ChassisMotion(per_joint("wheels", wheels, 3), 0.0)


class Fixed(Drive):
    """A base that does not move: a table, or a chair with its brakes on. It has no wheels to command."""

    moving: ClassVar[tuple[int, ...]] = ()
    radius = 1.0
    limit = math.inf

    @property
    def rolling(self) -> Array:
        """Empty matrix (0, 3), because this base has no wheels."""
        return np.zeros((0, 3))

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """Zero twist and zero slip, because this base does not move."""
        return ChassisMotion(np.zeros(3), 0.0)


@dataclass(frozen=True)
class Mecanum(Drive):
    """Mecanum wheels in the X arrangement: 1 front right, 2 front left, 3 rear left, 4 rear right.

    Eq. (2), Honzik, has x to the right and y forward, so its input is (-v_left, v_forward). a + b in Eq. (2) must be
    half the gauge plus half the wheelbase. With the full lengths, as in the paper's text, the chair would turn twice as
    fast as commanded. A positive speed rolls the wheel forward.

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
        checked_lengths(radius=self.radius, half_gauge=self.half_gauge, half_base=self.half_base, limit=self.limit)

    @property
    def rolling(self) -> Array:
        """(4, 3) matrix from chassis twist (forward, left, turn) to wheel speeds [rad/s]."""
        arm = self.half_gauge + self.half_base
        eq2 = np.array([[-1, 1, arm], [1, 1, -arm], [-1, 1, -arm], [1, 1, arm]]) / self.radius
        from_chassis = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
        return np.asarray(eq2 @ from_chassis, dtype=np.float64)

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """Chassis motion nearest to wheel speeds (4,) [rad/s], and the slip."""
        speeds = per_joint("wheels", wheels, 4)
        twist = np.linalg.pinv(self.rolling) @ speeds
        off = self.radius * (speeds - self.rolling @ twist)
        return ChassisMotion(twist, float(np.sqrt(np.mean(off * off))))


@dataclass(frozen=True)
class Differential(Drive):
    """Two driven wheels and castors; positive wheel speeds roll forward.

    Wheel 1 is right and wheel 2 left of the chassis origin.

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
        checked_lengths(radius=self.radius, half_gauge=self.half_gauge, limit=self.limit)

    @property
    def rolling(self) -> Array:
        """(2, 3) matrix from chassis twist (forward, left, turn) to wheel speeds [rad/s]; left has no effect."""
        return np.array([[1.0, 0.0, self.half_gauge], [1.0, 0.0, -self.half_gauge]]) / self.radius

    def slip(self, twist: ArrayLike) -> float:
        """[m/s] leftward speed of a twist (3,), which rolling wheels do not allow: Eq. (4), Honzik, times -1."""
        return float(per_joint("twist", twist, 3)[1])

    def motion(self, wheels: ArrayLike) -> ChassisMotion:
        """Chassis motion for wheel speeds (2,) [rad/s]; any two speeds fit without slip."""
        right, left = self.radius * per_joint("wheels", wheels, 2)
        return ChassisMotion(np.array([(right + left) / 2, 0.0, (right - left) / (2 * self.half_gauge)]), 0.0)


def checked_lengths(**numbers: float) -> None:
    """Raise `ConfigurationError` unless each value is a positive, finite number."""
    for name, number in numbers.items():
        positive(name, number)


def checked_amounts(**numbers: float) -> None:
    """Raise `ConfigurationError` unless each value is finite and not negative."""
    for name, number in numbers.items():
        if not (is_finite(number) and number >= 0.0):
            raise ConfigurationError(name, number, "a finite number of zero or more")
