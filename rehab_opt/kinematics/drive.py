"""What moves a base: which motions of the chassis its drive allows, and the wheel speeds that they take."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.kinematics.chain import per_joint

__all__ = ["ChassisMotion", "Drive", "Fixed", "Omnidirectional"]

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
    Controllers, plants, reports and the published law take what they know of a drive from these. How fast and how hard
    the chassis itself may move are limits of the chain.
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

    Its "wheel speeds" are that twist: forward, left [m/s], turn [rad/s]. Bounded are the speed along the floor as a
    whole, the turning, and the accelerations forward, to the left and turning.
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
