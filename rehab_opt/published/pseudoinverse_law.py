"""Weighted pseudoinverse with self-motion for chair and arm: Eqs. (1)-(5), Honzik.

Deviations: Eq. (3) maps world-frame speeds to the wheels, which is correct only at heading zero; here the chair's
speeds are first rotated into the chair's frame. Eq. (2) uses the axes and half lengths of `Mecanum`. The stick's
translation is in the chair's frame (section 4), so the heading rotates the rows of the Jacobian. As published, the
joint velocities have no bounds and grow without limit near a singular posture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.kinematics import DriveName
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm

__all__ = ["Excess", "PseudoinverseLaw"]

Array = NDArray[np.float64]
ROWS = ("x", "y", "z", "rx", "ry", "rz", "roll7")


class Excess(NamedTuple):
    """By how much a command violates each kind of limit, at most; zero or negative if it satisfies the limits."""

    position: float
    """[rad] violation by the joint positions after one tick."""
    velocity: float
    """[rad/s, m/s]; speeds of the chair are in its own frame."""
    acceleration: float
    """[rad/s^2, m/s^2]"""
    wheels: float
    """[rad/s]"""


class PseudoinverseLaw:
    """q' = J_W+ r' - (E - J_W+ J) grad c v(r'), with v(r') = |r'| times `self_motion`, Eq. (1).

    q' are the joint velocities, r' the hand's twist, J its Jacobian, J_W+ the pseudoinverse of J weighted by the
    inertia matrix W, E the identity and c the posture cost.

    Parameters
    ----------
    robot : its inertia is W, its `posture_cost` is c.
    drive : see `RedundancyResolver`; its constraints are added to the task, as the rolling row in Eq. (5).
    self_motion : weight of the self-motion; our choice, because the paper gives none.

    Raises
    ------
    ConfigurationError : an unknown drive.
    """

    def __init__(self, robot: MobileArm, *, drive: DriveName = "mecanum", self_motion: float = 1.0) -> None:
        self.robot, self.drive, self.self_motion = robot, drive, self_motion
        self._base = robot.drive(drive)

    def task_jacobian(self, q: ArrayLike, rows: Sequence[str], frame: str = "chassis") -> Array:
        """(k, 7) Jacobian rows for the stick's components `rows`, in the chair's or the world frame."""
        angles = np.asarray(q, dtype=np.float64)
        jacobian, pose = self.robot.chain.jacobian(angles), self.robot.chain.pose(angles)
        heading = float(angles[2]) if frame == "chassis" else 0.0
        cos, sin = math.cos(heading), math.sin(heading)
        to_frame = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        linear, angular = to_frame @ jacobian[:3], to_frame @ jacobian[3:]
        every = dict(zip(ROWS, [*linear, *angular, pose[:3, 2] @ jacobian[3:]], strict=True))
        return np.array([every[row] for row in rows])

    def rate(
        self, q: ArrayLike, twist: ArrayLike, rows: Sequence[str] = ("x", "y", "z"), frame: str = "chassis"
    ) -> Array:
        """(7,) joint velocities for a hand twist (k,); `rows` names its components in `frame`.

        The chair's velocities q1' and q2' are in the world frame.

        Raises
        ------
        numpy.linalg.LinAlgError : the rows are linearly dependent at this posture.
        """
        asked = np.asarray(twist, dtype=np.float64)
        jacobian, task = self.task_jacobian(q, rows, frame), asked
        still = self._base.constraints(q)
        if len(still):  # Eqs. (4) and (5)
            jacobian, task = np.vstack([jacobian, still]), np.append(asked, np.zeros(len(still)))
        softness = np.linalg.inv(self.robot.inertia(q))
        inverse = softness @ jacobian.T @ np.linalg.inv(jacobian @ softness @ jacobian.T)
        free = np.eye(self.robot.chain.n) - inverse @ jacobian
        size = self.self_motion * float(np.linalg.norm(asked))
        return np.asarray(inverse @ task - free @ self.robot.posture_gradient(q) * size)

    def wheels(self, q: ArrayLike, velocity: ArrayLike) -> Array:
        """Wheel speeds [rad/s] for joint velocities (7,): Eqs. (2) and (3), corrected as the module states."""
        chassis = self.robot.chassis_velocity(q, velocity)[:CHAIR]
        return self._base.wheel_speeds(chassis)

    def excess(self, q: ArrayLike, velocity: ArrayLike, last: ArrayLike, dt: float) -> Excess:
        """By how much the command `velocity` (7,) violates limits at q (7,), `dt` [s] after the command `last` (7,)."""
        chain, angles = self.robot.chain, np.asarray(q, dtype=np.float64)
        now, before = (self.robot.chassis_velocity(angles, each) for each in (velocity, last))
        ahead = angles + np.asarray(velocity, dtype=np.float64) * dt
        beyond = np.maximum(ahead - np.maximum(chain.upper, angles), np.minimum(chain.lower, angles) - ahead)
        speeds = np.append(np.abs(now[2:]) - chain.velocity[2:], np.hypot(now[0], now[1]) - chain.velocity[0])
        return Excess(
            position=float(np.max(beyond)),
            velocity=float(np.max(speeds)),
            acceleration=float(np.max(np.abs(now - before) / dt - chain.acceleration)),
            wheels=float(np.max(np.abs(self._base.wheel_speeds(now[:CHAIR])), initial=0.0) - self._base.limit),
        )
