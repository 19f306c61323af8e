"""What a stick commands of chair and arm: task rows, direction and speed, what is off them, Honzik's Eq. (1) for it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from rehab_opt.control.task_rows import ROWS
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.factor import solver_of, upper_triangle

__all__ = ["PROGRESS", "HandTask"]

PROGRESS = 20.0
"""[m/s] Price of a missing m/s of hand speed; one more costs about 1 in kinetic energy by the robot's mass."""
STEEP = 1e3
"""[m/s] Up to which the price follows that cost where it is higher, as it is near singular postures."""
STRAIGHT = 0.1
"""Fraction of the commanded speed by which the hand at the stop posture may move across the commanded direction."""
LIVELY = 1.0
"""[m/s or rad/s] Commanded speed up to which v(|r|) of Eq. (1) grows: a hand cannot be so fast, nor a stick mean it."""
TINY = 1e-12
"""[m/s] A speed that is no motion."""


@dataclass(frozen=True)
class HandTask:
    """Expressions of one tick for one set of task rows, velocities with the chair's in the chassis frame.

    Parameters
    ----------
    robot, rows, self_motion : see `ChairAndArm`. moving : joints that the wheels allow to move, by number from 0.
    """

    robot: MobileArm
    rows: tuple[str, ...]
    moving: list[int]
    self_motion: float

    def columns(
        self, q: ca.SX, twist: ca.SX, world: ca.SX, *, base: ca.SX, way: ca.SX, dt: float
    ) -> dict[str, ca.SX]:
        """Jacobian, inertia, costs, direction, speed, Eq. (1)'s answer with its multipliers; each one column.

        `base` (7,) is a tick of braking, `way` (7,) the way to the posture where braking ends, `dt` [s] the tick. All
        is of the middle of the tick, where a velocity that is held moves the hand as it does in the mean.
        """
        n, moving = self.robot.chain.n, self.moving
        jacobian = self.task_jacobian(q, world, way=base * (dt / 2))
        posture = ca.vertcat(ca.SX.zeros(CHAIR), (q + base * (dt / 2))[CHAIR:])
        inertia = self.robot.inertia_expression(posture) / self.robot.mass
        gradient = self.self_motion * self.robot.posture_gradient_expression(posture)

        commanded = twist / ca.fmax(ca.norm_2(twist) / self.fastest, 1)
        speed = ca.norm_2(commanded)
        direction = commanded / ca.fmax(speed, TINY)
        lively = ca.fmin(speed, LIVELY)

        # Eq. (1), and (5) by leaving out the left speed: u = W^-1 J' y - v grad c with J u = r.
        rows = ca.densify(jacobian[:, moving])
        soft = solver_of(inertia[moving, moving])(rows.T)
        y = solver_of(ca.triu2symm(ca.triu(rows @ soft)))(commanded + lively * (rows @ gradient[moving]))
        guess, at = ca.SX.zeros(n), soft @ y - lively * gradient[moving]
        for i, joint in enumerate(moving):
            guess[joint] = at[i]

        # What braking leaves of the hand's velocity that is not commanded.
        left = jacobian @ base
        error = left - clipped(ca.dot(direction, left), 0, speed) * direction
        size = ca.if_else(speed > 0, ca.norm_2(error), 0)  # without a command the whole robot brakes
        # The hand at the stop posture: along the command, and hardly across it.
        ahead = self.task_jacobian(q, world, way=way)
        across = ahead - direction @ (direction.T @ ahead)
        along_then, across_then, free = ca.dot(direction, ahead @ base), across @ base, STRAIGHT * speed
        steepness = ca.fmin(ca.fabs(ca.dot(direction, y)), STEEP)  # of the cost, at the guess
        return {
            "jacobian": ca.vec(ca.densify(jacobian)),
            "inertia": ca.densify(upper_triangle(inertia)),
            "self_motion": ca.densify(inertia @ gradient * lively),
            "direction": direction,
            "speed": speed,
            "price": PROGRESS + 2 * steepness,
            "error": ca.if_else(size > TINY, error / ca.fmax(size, TINY), 0),
            "error_size": ca.if_else(size > TINY, size, 0),
            "along": ca.densify((direction.T @ ahead).T),
            "along_lower": ca.fmin(along_then, 0),
            "across": ca.vec(ca.densify(across)),
            "across_lower": ca.fmin(across_then, -free),
            "across_upper": ca.fmax(across_then, free),
            "guess": guess,
            "multipliers": -y,
        }

    def task_jacobian(self, q: ca.SX, world: ca.SX, *, way: ca.SX) -> ca.SX:
        """(k, 7) rows that the stick commands, at q + way, by velocities with the chair's in the chassis frame at q."""
        posture = ca.vertcat(ca.SX.zeros(CHAIR), (q + way)[CHAIR:])
        jacobian, pose = self.robot.chain.jacobian_expression(posture), self.robot.chain.pose_expression(posture)
        heading = ca.if_else(world, q[2], 0)
        # The wheels' speeds forward and left are held as they are at q; all else has turned with the chair.
        turned, held = (_turn(angle) for angle in (heading + way[2], heading))
        linear = ca.horzcat(held @ jacobian[:3, :2], turned @ jacobian[:3, 2:])
        every = ca.vertcat(linear, turned @ jacobian[3:, :], pose[:3, 2].T @ jacobian[3:, :])
        return every[[ROWS.index(row) for row in self.rows], :]

    @property
    def fastest(self) -> float:
        """[m/s or rad/s] more than a hand can do in all rows together; what asks for more is slowed as a whole."""
        reach = sum(abs(row.a) + abs(row.d) for row in self.robot.chain.rows[CHAIR - 1 :])
        return float(self.robot.chain.velocity[0] + (1 + reach) * np.sum(self.robot.chain.velocity[CHAIR - 1 :]))


def _turn(angle: ca.SX) -> ca.SX:
    """(3, 3) rotation about the vertical."""
    cos, sin = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.horzcat(0, 0, 1))
