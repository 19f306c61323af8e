"""Task of chair and arm for the twist that a stick commands: task rows, and joint velocities by Honzik's Eq. 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.control.chair_limits import Limits
from rehab_opt.control.stopping import FAR, BrakingTogether
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.rows import MAX_MAGNITUDE, Row
from rehab_opt.symbolic.matrices import solver_of, upper_triangle
from rehab_opt.symbolic.tick import Stages

__all__ = ["FRAMES", "OFF", "PRICE", "ROWS", "HandTask", "Task", "checked_rows", "frame_number"]

ROWS = ("x", "y", "z", "rx", "ry", "rz", "roll7")
"""Task rows: hand velocity along and about the axes of the chosen frame, and about the wrist's own axis z7."""
FRAMES = {"chassis": 0.0, "world": 1.0}
PRICE = 2.0
"""[m/s] Price per m/s of missing hand speed; for comparison, kinetic energy over mass has a price of about 1."""
STEEP = 1e3
"""[m/s] Largest price. Smaller prices follow the marginal cost of Eq. 1, which is large near singular postures."""
OFF = 20.0
"""Factor on the price for speed off the commanded direction."""
CALM = 0.02
"""Weight of a change of velocity, as a fraction of the robot's mass; keeps light joints from shaking at bounds."""
STRAIGHT, BACK = 0.27, 0.05
"""Largest hand speed at the stop posture across and against the command, as fractions of the commanded speed."""
BARELY, ASIDE, UPHILL = 0.01, 0.06, 0.05
"""If Eq. 1 increases its posture cost c faster than `UPHILL` per second, joint speeds are limited to the fraction
(h^2 / h' - h') / `ASIDE`. Here h [m/s] is the hand speed at full joint speeds, and h' is `BARELY` times the commanded
speed. The joints thus stop before the singular posture, so a reversed stick leads back to the side that c prefers.
"""
ROUNDING = 1e-9
"""Relative margin of a velocity change to the acceleration limit."""
TINY = 1e-12
"""[m/s] Speeds below this count as zero."""
POSTURES, DEPENDENT = 3, 1e-6
"""Number of postures at which the rank of the rows is computed; singular value below which rows are dependent."""


class Task(NamedTuple):
    """Task of one tick as expressions; the chair's velocities are in the chassis frame. Symbols as in `ChairAndArm`."""

    jacobian: ca.SX
    """(k, n) J at mid-tick."""
    inertia: ca.SX
    """Upper triangle of the inertia W (n, n), divided by the robot's mass."""
    target: ca.SX
    """(n,) t; the QP weights deviations from these velocities with W."""
    analytic: ca.SX
    """(n,) answer without active bounds."""
    dual: ca.SX
    """(k,) multipliers of the task's rows at `analytic`."""
    direction: ca.SX
    """(k,) r/|r|."""
    size: ca.SX
    """[m/s or rad/s] |r|."""
    done: ca.SX
    """Fraction of the command that the hand delivered in the last tick."""
    speed: ca.SX
    """[m/s or rad/s] Upper bound of the progress."""
    price: ca.SX
    """[m/s] Price per m/s of missing hand speed."""
    turning: ca.SX
    """(k,) w: hand velocity off the commanded direction that is allowed in this tick."""
    error: ca.SX
    """(k,) e/|e|, where e is the further hand velocity off the commanded direction that braking leaves."""
    off: ca.SX
    """|e|, the upper bound of the QP's variable `off`."""
    ahead: ca.SX
    """(k, n) rows of the hand's velocity at the stop posture, between `ahead_lower` and `ahead_upper` (k,)."""
    ahead_lower: ca.SX
    ahead_upper: ca.SX


@dataclass(frozen=True)
class HandTask:
    """Expressions of one tick for one set of task rows; the chair's velocities are in the chassis frame."""

    robot: MobileArm
    rows: tuple[str, ...]
    moving: list[int]
    self_motion: float

    def rank(self) -> int:
        """Largest number of independent rows at a few random postures."""
        arm = ca.SX.sym("arm", self.robot.chain.n - CHAIR)
        rows = ca.Function("rows", [arm], [self.task_jacobian(arm, turned=ca.SX(0), heading=ca.SX(0))[:, self.moving]])
        postures = np.random.default_rng(0).uniform(-1, 1, (POSTURES, arm.numel()))
        return max(int(np.linalg.matrix_rank(np.array(rows(each)), tol=DEPENDENT)) for each in postures)

    def task(
        self, tick: Stages, q: ca.SX, twist: ca.SX, world: ca.SX, *, last: ca.SX, limits: Limits,
        braking: BrakingTogether, dt: float,
    ) -> Task:  # fmt: skip
        """Task for a commanded twist (k,), in the world's frame if `world` is 1, after the velocity `last` (n,)."""
        moving, base = self.moving, limits.base
        half, heading = last * (dt / 2), ca.if_else(world, q[2], 0)
        posture = ca.vertcat(0, 0, 0, q[CHAIR:])
        here = self.task_jacobian(q[CHAIR:], turned=ca.SX(0), heading=heading)
        jacobian = tick.once(self.task_jacobian((q + half)[CHAIR:], turned=half[2], heading=heading))
        was = ca.if_else(world, q[2] - 2 * half[2], 0)
        before = self.task_jacobian((q - half)[CHAIR:], turned=half[2], heading=was)
        inertia = self.robot.inertia_expression(posture) / self.robot.mass
        commanded = twist / ca.fmax(ca.norm_2(twist) / self.fastest, 1)
        size, left = ca.norm_2(commanded), braking.slower(ca.SX(1))
        direction = commanded / ca.fmax(size, TINY)

        # Eq. 1, and Eq. 5 without the sideways speed: u = W^-1 J' y - v grad c with J u = r. Then the smallest
        # change that gives the same r at mid-tick.
        weigh = solver_of(inertia[moving, moving])

        def firm(matrix: ca.SX) -> tuple[ca.SX, Callable[[ca.SX], ca.SX]]:
            rows = ca.densify(matrix[:, moving])
            soft = weigh(rows.T)
            return soft, solver_of(ca.triu2symm(ca.triu(rows @ soft)))

        (soft, firmness), gradient = firm(here), self.self_motion * self.robot.posture_gradient_expression(posture)
        factor = self._kept_aside(soft @ firmness(commanded), gradient, size)
        direction, commanded = ca.if_else(factor < 0, -direction, direction), factor * commanded
        sought = ca.fabs(factor) * size
        y = firmness(commanded + sought * (here @ gradient))
        free = self._spread(soft @ y - sought * gradient[moving])
        # An answer faster than the joints (near singular postures) only gives a direction.
        faster = ca.fmax(ca.mmax(ca.fabs(free) / self.robot.chain.velocity), 1)
        towards = ca.if_else(ca.sumsqr(free) <= MAX_MAGNITUDE**2, free / faster, 0)
        soft, firmness = firm(jacobian)
        change = firmness(commanded - jacobian @ free)
        law = free + self._spread(soft @ change)
        # Start from the last motion and go as far towards Eq. 1 as the accelerations allow.
        hand = before @ last
        along = clipped(ca.dot(direction, hand), 0, sought)
        aside = hand - along * direction
        x = firmness(along * direction + left * aside - jacobian @ last)
        kept = last + self._spread(soft @ x)
        way = clipped(law, limits.lower, limits.upper) - kept
        room = ca.fmax(ca.if_else(way > 0, last + braking.change - kept, kept - last + braking.change), 0)
        fits = ca.if_else(ca.fabs(way) > TINY, room / ca.fmax(ca.fabs(way), TINY), 2)
        part = ca.fmin(1, (1 - ROUNDING) * ca.mmin(fits))
        valid = ca.logic_and(ca.sumsqr(law) + ca.sumsqr(kept) <= MAX_MAGNITUDE**2, size > 0)
        part = ca.if_else(valid, part, 1)
        turning = tick.once(ca.if_else(valid, (1 - part) * left * aside, 0))
        speed = tick.once(along + part * (sought - along))
        # Motion off the commanded direction that hard braking leaves; always feasible.
        error = jacobian @ base - turning
        error -= clipped(ca.dot(direction, error), 0, speed) * direction
        off = ca.if_else(size > 0, ca.norm_2(error), 0)  # without a command all joints brake
        turns = ca.norm_2(turning)
        ahead = self._ahead(tick, q, last, direction, size, left=turns, world=world, base=base, braking=braking)
        return Task(
            jacobian=ca.densify(jacobian),
            inertia=ca.densify(upper_triangle(inertia)),
            target=part * towards + (1 - part) * last,
            analytic=part * law + (1 - part) * kept,
            dual=-part * change - (1 - part) * x,
            direction=direction,
            size=size,
            done=along / ca.fmax(size, TINY),
            speed=speed,
            price=PRICE + 2 * ca.fmin(ca.fabs(ca.dot(direction, part * y + (1 - part) * x)), STEEP),
            turning=turning,
            error=ca.if_else(off > TINY, error / ca.fmax(off, TINY), 0),
            off=ca.if_else(off > TINY, off, 0),
            ahead=ahead.expression,
            ahead_lower=ahead.lower,
            ahead_upper=ahead.upper,
        )

    def _ahead(
        self, tick: Stages, q: ca.SX, last: ca.SX, direction: ca.SX, size: ca.SX, *, left: ca.SX, world: ca.SX,
        base: ca.SX, braking: BrakingTogether,
    ) -> Row:  # fmt: skip
        """Rows (k, n) and bounds of the hand's velocity at the stop posture, linearised after a tick of braking."""
        slower, each = braking.slower(last), ca.SX.sym("u", last.numel())
        place = q + braking.time * each
        heading = ca.if_else(world, place[2], 0)
        hand = self.task_jacobian(place[CHAIR:], turned=ca.SX(0), heading=heading) @ each
        hand = ca.vertcat(direction.T, self._square(direction)) @ hand
        then, there = tick.once(tuple(ca.substitute([ca.jacobian(hand, each), hand], [each], [slower])))
        fixed = there - then @ slower
        back, straight = (ca.if_else(size > 0, ca.fmax(part * size, left), FAR) for part in (BACK, STRAIGHT))
        square = ca.SX.ones(hand.numel() - 1)
        lower, upper = ca.vertcat(-back, -straight * square), ca.vertcat(FAR, straight * square)
        braked = fixed + then @ base
        lower, upper = ca.fmin(lower, ca.fmin(there, braked)), ca.fmax(upper, ca.fmax(there, braked))
        return Row(ca.densify(then), lower - fixed, upper - fixed)

    def _kept_aside(self, joints: ca.SX, gradient: ca.SX, size: ca.SX) -> ca.SX:
        """Factor on the joint speeds near a singular posture, see `ASIDE`."""
        if self.moving[0] < CHAIR or not {"x", "y", "z"} <= set(self.rows):
            return ca.SX(1)
        worth = 1 / ca.mmax(ca.fabs(joints) / self.robot.chain.velocity[self.moving])
        uphill = clipped(worth * ca.dot(gradient[self.moving], joints) / UPHILL, 0, 1)
        aside = ca.fmin(worth * (worth**2 - BARELY**2) * size / (BARELY * ASIDE), 1)
        return ca.if_else(uphill > 0, 1 - uphill * (1 - aside), 1)

    @staticmethod
    def _square(direction: ca.SX) -> ca.SX:
        """Orthonormal rows (k - 1, k), all orthogonal to `direction` (k,), by a Householder reflection."""
        first = direction[0]
        mirror = direction + ca.vertcat(ca.if_else(first < 0, -1, 1), ca.SX.zeros(direction.numel() - 1))
        return (ca.SX.eye(direction.numel()) - mirror @ mirror.T / (1 + ca.fabs(first)))[1:, :]

    def _spread(self, velocity: ca.SX) -> ca.SX:
        every = ca.SX.zeros(self.robot.chain.n)
        for i, joint in enumerate(self.moving):
            every[joint] = velocity[i]
        return every

    def task_jacobian(self, arm: ca.SX, *, turned: ca.SX, heading: ca.SX) -> ca.SX:
        """Jacobian (k, n) of the task rows at the arm's joints `arm`.

        turned : [rad] rotation of the chair relative to the frame of its velocities.
        heading : [rad] rotation of that frame relative to the frame of the task rows.
        """
        posture = ca.vertcat(0, 0, turned, arm)
        jacobian, pose = self.robot.chain.jacobian_expression(posture), self.robot.chain.pose_expression(posture)
        cos, sin = ca.cos(heading), ca.sin(heading)
        turn = ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.horzcat(0, 0, 1))
        every = ca.vertcat(turn @ jacobian[:3, :], turn @ jacobian[3:, :], pose[:3, 2].T @ jacobian[3:, :])
        return every[[ROWS.index(row) for row in self.rows], :]

    @property
    def fastest(self) -> float:
        """Upper bound [m/s or rad/s] of the hand's speed in all rows; faster commands are scaled down to it."""
        reach = sum(row.across + abs(row.along) for row in self.robot.chain.rows[CHAIR - 1 :])
        reach += float(np.linalg.norm(self.robot.chain.tool[:3, 3]))
        return float(self.robot.chain.velocity[0] + (1 + reach) * np.sum(self.robot.chain.velocity[CHAIR - 1 :]))


def frame_number(frame: str) -> float:
    """Number of a frame of the task rows in the QP: 0 for the chassis frame, 1 for the world frame."""
    world = FRAMES.get(frame) if isinstance(frame, str) else None
    if world is None:
        raise ConfigurationError("frame", frame, "chassis or world")
    return world


def checked_rows(rows: Sequence[str], argument: str = "rows") -> tuple[str, ...]:
    """Check that task rows can be commanded together; `argument` names their source in errors."""
    names = tuple(rows) if isinstance(rows, (tuple, list)) else ()
    known = all(isinstance(name, str) and name in ROWS for name in names)
    if not names or not known or len(set(names)) != len(names):
        raise ConfigurationError(argument, rows, f"a tuple of different ones of {', '.join(ROWS)}")
    if {"rx", "ry", "rz", "roll7"} <= set(names):
        raise ConfigurationError(argument, rows, "roll7, or all of rx, ry and rz, which say it already")
    return names
