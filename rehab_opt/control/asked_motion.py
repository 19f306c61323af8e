"""What a stick asks of chair and arm: its rows, its twist within the accelerations, and Honzik's Eq. (1) for it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from rehab_opt.control.room import Room
from rehab_opt.control.task_rows import ROWS
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.factor import solver_of, upper_triangle
from rehab_opt.optim.qp import PLAUSIBLE

__all__ = ["PROGRESS", "AskedMotion"]

PROGRESS = 20.0
"""[m/s] Price of a missing m/s of hand speed; one more costs about 1 in kinetic energy by the robot's mass."""
STEEP = 1e3
"""[m/s] Up to which the price follows that cost where it is higher, as it is near singular postures."""
TINY = 1e-12
"""[m/s] A speed that is no motion."""


@dataclass(frozen=True)
class AskedMotion:
    """Expressions of one tick for one set of task rows, velocities with the chair's in the chassis frame.

    Parameters
    ----------
    robot, rows, self_motion, dt : see `ChairAndArm`. moving : joints that the wheels allow to move, by number from 0.
    """

    robot: MobileArm
    rows: tuple[str, ...]
    moving: list[int]
    self_motion: float
    dt: float

    def columns(self, q: ca.SX, twist: ca.SX, world: ca.SX, memory: ca.SX, room: Room) -> dict[str, ca.SX]:
        """Jacobian, inertia, costs, direction, speed and the law's answer with its multipliers, each one column.

        The memory begins with the last velocities and ends with what the last tick delivered, and in which frame.
        """
        last = memory[: self.robot.chain.n]
        n, moving = self.robot.chain.n, self.moving
        posture = ca.vertcat(ca.SX.zeros(CHAIR), q[CHAIR:])
        jacobian = self.task_jacobian(q, world)
        inertia = self.robot.inertia_expression(posture) / self.robot.mass
        gradient = self.self_motion * self.robot.posture_gradient_expression(posture)

        # Eq. (1), and (5) by leaving out the left speed: u = W^-1 J' y - v grad c with J u = r.
        rows = ca.densify(jacobian[:, moving])
        soft = solver_of(inertia[moving, moving])(rows.T)
        firmness = solver_of(ca.triu2symm(ca.triu(rows @ soft)))
        idle = rows @ gradient[moving]

        def law(r: ca.SX, size: ca.SX) -> tuple[ca.SX, ca.SX]:
            y = firmness(r + size * idle)
            velocity, at = ca.SX.zeros(n), soft @ y - size * gradient[moving]
            for i, joint in enumerate(moving):
                velocity[joint] = at[i]
            return velocity, y

        # The asked twist, led there from the last one.
        asked = twist / ca.fmax(ca.norm_2(twist) / self.fastest, 1)
        full, _ = law(asked, ca.norm_2(asked))
        needed = ca.fabs(clipped(full, room.lower, room.upper) - last)
        allowed = ca.DM(np.minimum(self.robot.chain.acceleration * self.dt, 2 * self.robot.chain.velocity))
        share = ca.fmin(1, ca.mmin(allowed / ca.fmax(needed, TINY)))
        share = ca.if_else(ca.sumsqr(full) <= PLAUSIBLE**4, share, 1)  # no law at a singular posture
        # As it was delivered, not as the last velocities would move the hand from here: that turns with the arm.
        before = ca.if_else(memory[-1] == world, memory[-1 - len(self.rows) : -1], jacobian @ last)
        limited = ca.if_else(ca.sumsqr(twist) > 0, before + share * (asked - before), 0)
        speed = ca.norm_2(limited)
        direction = limited / ca.fmax(speed, TINY)
        guess, y = law(limited, speed)
        steepness = ca.fmin(ca.fabs(ca.dot(direction, y)), STEEP)  # of the cost, at the guess
        return {
            "jacobian": ca.vec(ca.densify(jacobian)),
            "inertia": ca.densify(upper_triangle(inertia)),
            "self_motion": ca.densify(inertia @ gradient * speed),
            "direction": direction,
            "speed": speed,
            "price": PROGRESS + 2 * steepness,
            "guess": guess,
            "multipliers": -y,
        }

    def task_jacobian(self, q: ca.SX, world: ca.SX) -> ca.SX:
        """(k, 7) rows that the stick asks for, by velocities with the chair's in the chassis frame."""
        posture = ca.vertcat(ca.SX.zeros(CHAIR), q[CHAIR:])
        jacobian, pose = self.robot.chain.jacobian_expression(posture), self.robot.chain.pose_expression(posture)
        heading = ca.if_else(world, q[2], 0)
        cos, sin = ca.cos(heading), ca.sin(heading)
        turn = ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.horzcat(0, 0, 1))
        every = ca.vertcat(turn @ jacobian[:3, :], turn @ jacobian[3:, :], pose[:3, 2].T @ jacobian[3:, :])
        return every[[ROWS.index(row) for row in self.rows], :]

    @property
    def fastest(self) -> float:
        """[m/s or rad/s] more than a hand can do in all rows together; what asks for more is slowed as a whole."""
        reach = sum(abs(row.a) + abs(row.d) for row in self.robot.chain.rows[CHAIR - 1 :])
        return float(self.robot.chain.velocity[0] + (1 + reach) * np.sum(self.robot.chain.velocity[CHAIR - 1 :]))
