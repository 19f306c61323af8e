"""Task of chair and arm for a stick's twist: rows, direction, speed, motion off the direction, Honzik's Eq. (1)."""

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

__all__ = ["AHEAD", "FRAMES", "PROGRESS", "ROWS", "HandTask", "Last", "Task", "checked_rows", "frame_number"]

ROWS = ("x", "y", "z", "rx", "ry", "rz", "roll7")
"""Task rows: hand velocity along and about the axes of the chosen frame, and about the wrist's own axis z7."""
FRAMES = {"chassis": 0.0, "world": 1.0}
PROGRESS = 2.0
"""[m/s] Price of a missing m/s of hand speed; one more costs about 1 in kinetic energy by the robot's mass.

Prices of 3 to 8 shake joints at bounds. See `CREEPS`.
"""
CREEPS, GOES, WORTH = 0.2, 0.5, 0.025
"""Fractions of the commanded speed. While a hand is below the first, the price of progress grows where what moves it,
as fast as a joint allows, would give it the third, and falls where not; past the second it falls, too. Half a m/s of
the chair for a twentieth of the hand's is else too dear, and the hand stops.
"""
BARELY, ASIDE, UPHILL = 0.01, 0.06, 0.05
"""Where Eq. (1) leads up c by more than the third a second, joints go at (h^2 / h' - h') / `ASIDE` of their speeds at
most, h [m/s] what those give the hand, h' the first of its command: they rest where h = h', on the side of a singular
posture that c prefers, to which a reversed stick leads. At it rounding decides, and one way may end at a joint limit.
"""
GROWING, FIRST, DEAREST = 0.5, 0.37, 100.0
"""[s] in which that price grows or falls e-fold; least factor on `PROGRESS`, below 1 as 1; the most, of a row's too."""
STEEP = 1e3
"""[m/s] Up to which the price follows that cost where it is higher, as it is near singular postures."""
AHEAD = (0.5, 1.0)
"""Parts of the way to the stop posture where the hand must still be on its way."""
STRAIGHT = 0.27
"""Fraction of the commanded speed by which J u may be off the hand's way there, in each direction square to it.

Less makes hands slow near singular postures.
"""
HURRY = 0.3
"""Fraction of it by which the hand may be off the command without hurry; what is more goes as its joints can stop.

Not beside limits of a user's own and a `Clearance`: giving way to what comes is off the command.
"""
BACK = 0.05
"""Fraction of it by which it may move against that: stretched, a hand must turn back to go on."""
LIVELY = 1.0
"""[m/s or rad/s] Commanded speed up to which v(|r|) of Eq. (1) grows: a hand cannot be so fast, nor a stick mean it."""
OFF = 20.0
"""How many times more a m/s off the commanded direction costs than one that is missing along it.

What is off goes no faster than braking takes it away, and it adds up.
"""
HAIR = 2e-3
"""Fraction of the command that may be off it for nothing, a tick's share of which adds up to that. Joints with next
to no lever would else turn to and fro.
"""
ROUNDING = 1e-9
"""Fraction by which a change stays within the accelerations, so that it is seen to."""
TINY = 1e-12
"""[m/s] A speed that is no motion."""
POSTURES, DEPENDENT = 3, 1e-6
"""Where rows are compared; the singular value below which a hand cannot do all of them."""


class Last(NamedTuple):
    """Result of the last tick, velocities with the chair's in the chassis frame."""

    velocity: ca.SX
    """(7,)"""
    hand: ca.SX
    """(k,) the hand's, as the command delivered it."""
    insistence: ca.SX
    """Factor on the price of progress; below 1 as 1."""
    frame: ca.SX
    """0 or 1: the frame of `hand`; another number where it is not known."""


class Task(NamedTuple):
    """The task of one tick in expressions, velocities with the chair's in the chassis frame."""

    jacobian: ca.SX
    """(k, n) J, of the middle of the tick."""
    inertia: ca.SX
    """Upper triangle of W (n, n), over the robot's mass."""
    target: ca.SX
    """(n,) velocity about which W counts."""
    direction: ca.SX
    """(k,) r/|r|."""
    speed: ca.SX
    """[m/s or rad/s] upper bound of the progress."""
    turning: ca.SX
    """(k,) w, what may be left of the hand's motion off the command."""
    error: ca.SX
    """(k,) e/|e|, e what braking leaves besides."""
    off: ca.SX
    """|e|, upper bound of what is off the command."""
    price: ca.SX
    """Of a m/s of progress."""
    dear: ca.SX
    """Of one off the command."""
    multiplier: ca.SX
    """Size of the multipliers of the task's rows at that price: near singular postures one is far dearer."""
    stiffness: ca.SX
    """(4,) of the arm's joints: how fast what J u is worth by them falls where the arm goes on as it went, over its way
    in a second, by the levers of the hand; 0 where it rises."""
    missing: ca.SX
    """Fraction of the command that the hand lacks."""
    insistence: ca.SX
    """See `Last`, of this tick."""
    ahead: ca.SX
    """(m, n) rows of the hand's velocity while it brakes, within `ahead_lower` and `ahead_upper` (m,)."""
    ahead_lower: ca.SX
    ahead_upper: ca.SX
    analytic: ca.SX
    """(n,) the answer where no bound is active."""
    dual: ca.SX
    """(k,) multipliers of the task's rows there."""


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

    def rank(self) -> int:
        """How many rows are independent of each other, at the best of a few postures."""
        arm = ca.SX.sym("arm", self.robot.chain.n - CHAIR)
        rows = ca.Function("rows", [arm], [self.task_jacobian(arm, turned=ca.SX(0), heading=ca.SX(0))[:, self.moving]])
        postures = np.random.default_rng(0).uniform(-1, 1, (POSTURES, arm.numel()))
        return max(int(np.linalg.matrix_rank(np.array(rows(each)), tol=DEPENDENT)) for each in postures)

    def task(
        self,
        tick: Stages,
        q: ca.SX,
        twist: ca.SX,
        world: ca.SX,
        *,
        last: Last,
        limits: Limits,
        braking: BrakingTogether,
        dt: float,
    ) -> Task:
        """The task for the twist (k,) that is commanded, in the world's frame where `world` is 1.

        The Jacobian is of the middle of the tick, where a velocity that is held moves the hand as it does in the mean;
        what the law makes of its freedom is of q: light joints would shake if their own speed decided how they share.
        """
        moving, base = self.moving, limits.base
        half, heading = last.velocity * (dt / 2), ca.if_else(world, q[2], 0)
        jacobian = tick.once(self.task_jacobian((q + half)[CHAIR:], turned=half[2], heading=heading))
        here, posture = self.task_jacobian(q[CHAIR:], turned=ca.SX(0), heading=heading), ca.vertcat(0, 0, 0, q[CHAIR:])
        inertia = self.robot.inertia_expression(posture) / self.robot.mass

        commanded = twist / ca.fmax(ca.norm_2(twist) / self.fastest, 1)
        size, gently = ca.norm_2(commanded), braking.slower(ca.SX(1))
        direction = commanded / ca.fmax(size, TINY)

        # Eq. (1), and (5) by leaving out the left speed: u = W^-1 J' y - v grad c with J u = r. Then by the least
        # change to the same r in the middle of the tick.
        weigh = solver_of(inertia[moving, moving])

        def firm(matrix: ca.SX) -> tuple[ca.SX, Callable[[ca.SX], ca.SX]]:
            rows = ca.densify(matrix[:, moving])
            soft = weigh(rows.T)
            return soft, solver_of(ca.triu2symm(ca.triu(rows @ soft)))

        (soft, firmness), gradient = firm(here), self.self_motion * self.robot.posture_gradient_expression(posture)
        factor = self._kept_aside(soft @ firmness(commanded), gradient, size)
        direction, sought = ca.if_else(factor < 0, -direction, direction), ca.fabs(factor) * size
        lively, commanded = ca.fmin(sought, LIVELY), factor * commanded
        y = firmness(commanded + lively * (here @ gradient))
        target = self._spread(soft @ y - lively * gradient[moving])
        # Faster than the joints can be it is a direction. Near singular postures it is far faster, and turns round from
        # one side to the other: joints went to and fro at their accelerations between them.
        faster = ca.fmax(ca.mmax(ca.fabs(target) / self.robot.chain.velocity), 1)
        towards = ca.if_else(ca.sumsqr(target) <= MAX_MAGNITUDE**2, target / faster, 0)
        soft, firmness = firm(jacobian)
        change = firmness(commanded - jacobian @ target)
        law = target + self._spread(soft @ change)
        # Going on as before, with the hand's velocity as the last tick meant it: the Jacobian has turned since.
        before = ca.if_else(last.frame == world, last.hand, jacobian @ last.velocity)
        along = clipped(ca.dot(direction, before), 0, sought)
        aside = before - along * direction
        x = firmness(along * direction + gently * aside - jacobian @ last.velocity)
        kept, goes = last.velocity + self._spread(soft @ x), firmness(aside)

        # As far from the one to the other as the accelerations allow.
        way = clipped(law, limits.lower, limits.upper) - kept
        ahead, behind = last.velocity + braking.change - kept, kept - (last.velocity - braking.change)
        free = ca.fmax(ca.if_else(way > 0, ahead, behind), 0) / ca.fmax(ca.fabs(way), TINY)
        part = ca.fmin(1, (1 - ROUNDING) * ca.mmin(ca.if_else(ca.fabs(way) > TINY, free, 2)))
        valid = ca.logic_and(
            ca.sumsqr(law) + ca.sumsqr(kept) <= MAX_MAGNITUDE**2, size > 0
        )  # no law at a singular posture
        part = ca.if_else(valid, part, 1)
        # Where the law is far away, what is off the command goes sooner than on the way to it.
        left = (1 - part) * gently
        hurry = 0 if limits.beside.row_count else ca.fmax(1 - HURRY * size / ca.fmax(ca.norm_2(aside), TINY), 0)
        keeps = 1 - hurry * (1 - braking.leaves(self._spread(soft @ goes)))
        sooner = ca.fmax(left - ca.fmin(braking.leaves(last.velocity), keeps), 0)
        turning, pull = tick.once(ca.if_else(valid, (left - sooner) * aside, 0)), ca.if_else(valid, sooner * goes, 0)
        speed = tick.once(along + part * (sought - along))
        # What braking leaves of the hand's velocity besides: that can be had in any case.
        hard, gentle = (
            besides - clipped(ca.dot(direction, besides), 0, speed) * direction
            for besides in (jacobian @ base - turning, jacobian @ braking.slower(last.velocity) - turning)
        )
        free, least, most = HAIR * (1 - gently) * size, ca.norm_2(hard), ca.norm_2(gentle)
        error = ca.if_else(ca.logic_and(least <= most, most <= free), gentle, hard)
        off = ca.if_else(size > 0, ca.norm_2(error), 0)  # without a command the whole robot brakes

        on_the_way = self._rows_ahead(
            tick, q, last.velocity, direction, size, left=ca.norm_2(turning), world=world, base=base, braking=braking
        )
        insistence, cost = self._insistence(last, along, size, dt), ca.dot(direction, part * y + (1 - part) * x)
        price = PROGRESS * ca.fmax(insistence, 1) + 2 * ca.fmin(ca.fabs(cost), STEEP)
        multipliers = price * self._of_progress(y, direction)
        return Task(
            jacobian=ca.densify(jacobian),
            inertia=ca.densify(upper_triangle(inertia)),
            target=part * towards + (1 - part) * last.velocity,
            direction=direction,
            speed=speed,
            turning=turning,
            error=ca.if_else(off > TINY, error / ca.fmax(off, TINY), 0),
            off=ca.if_else(off > TINY, off, 0),
            price=price,
            dear=ca.if_else(off <= free, 0, OFF * price),
            multiplier=ca.norm_2(multipliers),
            stiffness=self._stiffness(posture, last.velocity, multipliers, (jacobian - here) * 2 / dt),
            missing=1 - along / ca.fmax(size, TINY),
            insistence=insistence,
            ahead=on_the_way.expression,
            ahead_lower=on_the_way.lower,
            ahead_upper=on_the_way.upper,
            analytic=part * law + (1 - part) * kept - self._spread(soft @ pull),
            dual=pull - part * change - (1 - part) * x,
        )

    def _rows_ahead(
        self,
        tick: Stages,
        q: ca.SX,
        last: ca.SX,
        direction: ca.SX,
        size: ca.SX,
        *,
        left: ca.SX,
        world: ca.SX,
        base: ca.SX,
        braking: BrakingTogether,
    ) -> Row:
        """Rows (m, n) of the hand's velocity J u at the places `AHEAD`, and their bounds (m,).

        By its tangent at `slower`, since the places move with u. The velocities are those of the chassis as it stands
        there, and so is what the stick commands in the chassis frame.

        left : [m/s or rad/s] what may be left off the command after this tick and there: a robot far faster than its
        command is else kept so by these tangents.
        """
        slower, each = braking.slower(last), ca.SX.sym("u", last.numel())
        axes = ca.vertcat(direction.T, self._square(direction))
        back, straight = (ca.if_else(size > 0, ca.fmax(part * size, left), FAR) for part in (BACK, STRAIGHT))
        rows = []
        for part in AHEAD:
            place = q + part * braking.time * each
            heading = ca.if_else(world, place[2], 0)
            hand = axes @ self.task_jacobian(place[CHAIR:], turned=ca.SX(0), heading=heading) @ each
            then, there = tick.once(tuple(ca.substitute([ca.jacobian(hand, each), hand], [each], [slower])))
            fixed, braked = there - then @ slower, there + ca.fmin(then @ (base - slower), 0)
            faster = there + ca.fmax(then @ (base - slower), 0)
            lower = ca.vertcat(-back, -straight * ca.SX.ones(hand.numel() - 1))
            upper = ca.vertcat(ca.inf, straight * ca.SX.ones(hand.numel() - 1))
            rows.append(Row(then, ca.fmin(braked, lower) - fixed, ca.fmax(faster, upper) - fixed))
        return Row(*(ca.densify(ca.vertcat(*each)) for each in zip(*rows, strict=True)))

    @staticmethod
    def _of_progress(y: ca.SX, direction: ca.SX) -> ca.SX:
        """(k,) multipliers y of the task's rows where a m/s of progress is worth 1; the direction where unusable."""
        y = ca.if_else(ca.sumsqr(y) < FAR**4, y, direction)
        return y / ca.fmax(ca.fabs(ca.dot(direction, y)), ca.norm_2(y) / DEAREST + TINY)

    def _kept_aside(self, joints: ca.SX, gradient: ca.SX, size: ca.SX) -> ca.SX:
        """Factor on a command: see `ASIDE`. Fewer rows leave self-motion, and so does a chair that drives."""
        if self.moving[0] < CHAIR or not {"x", "y", "z"} <= set(self.rows):
            return ca.SX(1)
        worth = 1 / ca.mmax(ca.fabs(joints) / self.robot.chain.velocity[self.moving])
        uphill = clipped(worth * ca.dot(gradient[self.moving], joints) / UPHILL, 0, 1)
        aside = ca.fmin(worth * (worth**2 - BARELY**2) * size / (BARELY * ASIDE), 1)
        return ca.if_else(uphill > 0, 1 - uphill * (1 - aside), 1)

    def _stiffness(self, posture: ca.SX, last: ca.SX, multipliers: ca.SX, turning: ca.SX) -> ca.SX:
        """(4,) see `Task`, where J turns by `turning` (k, n) a second."""
        levers = ca.sum1(self.robot.chain.jacobian_expression(posture)[:3, CHAIR:] ** 2).T
        falls = -ca.dot(multipliers, turning @ last)
        return ca.densify(levers * ca.fmax(falls, 0) / ca.fmax(ca.dot(levers, last[CHAIR:] ** 2), TINY))

    @staticmethod
    def _square(direction: ca.SX) -> ca.SX:
        """(k - 1, k) unit rows square to each other and to `direction` (k,): a mirror leads the first axis to that."""
        first = direction[0]
        mirror = direction + ca.vertcat(ca.if_else(first < 0, -1, 1), ca.SX.zeros(direction.numel() - 1))
        return (ca.SX.eye(direction.numel()) - mirror @ mirror.T / (1 + ca.fabs(first)))[1:, :]

    def _spread(self, velocity: ca.SX) -> ca.SX:
        every = ca.SX.zeros(self.robot.chain.n)
        for i, joint in enumerate(self.moving):
            every[joint] = velocity[i]
        return every

    def _insistence(self, last: Last, along: ca.SX, size: ca.SX, dt: float) -> ca.SX:
        """Of a hand that goes `along` of `size`: see `CREEPS`."""
        effort = ca.mmax(ca.fabs(last.velocity) / self.robot.chain.velocity)
        worth, step = along > WORTH * size * effort, dt / GROWING
        growth = ca.if_else(along > GOES * size, -step, 0)
        growth = ca.if_else(along < CREEPS * size, ca.if_else(worth, step, -step), growth)
        return ca.if_else(size > 0, ca.fmin(ca.fmax(last.insistence * (1 + growth), FIRST), DEAREST), FIRST)

    def task_jacobian(self, arm: ca.SX, *, turned: ca.SX, heading: ca.SX) -> ca.SX:
        """(k, 7) rows that the stick commands, at arm joints (4,), of velocities with the chair's in its own frame.

        turned : [rad] by which the chair has turned since that frame. heading : [rad] of that frame in the rows' own.
        """
        posture = ca.vertcat(0, 0, turned, arm)
        jacobian, pose = self.robot.chain.jacobian_expression(posture), self.robot.chain.pose_expression(posture)
        cos, sin = ca.cos(heading), ca.sin(heading)
        turn = ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.horzcat(0, 0, 1))
        every = ca.vertcat(turn @ jacobian[:3, :], turn @ jacobian[3:, :], pose[:3, 2].T @ jacobian[3:, :])
        return every[[ROWS.index(row) for row in self.rows], :]

    @property
    def fastest(self) -> float:
        """[m/s or rad/s] more than a hand can do in all rows together; what asks for more is slowed as a whole."""
        reach = sum(row.across + abs(row.along) for row in self.robot.chain.rows[CHAIR - 1 :])
        reach += float(np.linalg.norm(self.robot.chain.tool[:3, 3]))
        return float(self.robot.chain.velocity[0] + (1 + reach) * np.sum(self.robot.chain.velocity[CHAIR - 1 :]))


def frame_number(frame: str) -> float:
    """Frame of the task rows as a parameter of the QP: 0 the chassis frame, 1 the world's."""
    world = FRAMES.get(frame) if isinstance(frame, str) else None
    if world is None:
        raise ConfigurationError("frame", frame, "chassis or world")
    return world


def checked_rows(rows: Sequence[str], argument: str = "rows") -> tuple[str, ...]:
    """Task rows that can be commanded together; `argument` is the one they come from, alone or as one set."""
    names = tuple(rows) if isinstance(rows, (tuple, list)) else ()
    known = all(isinstance(name, str) and name in ROWS for name in names)
    if not names or not known or len(set(names)) != len(names):
        raise ConfigurationError(argument, rows, f"a tuple of different ones of {', '.join(ROWS)}")
    if {"rx", "ry", "rz", "roll7"} <= set(names):
        raise ConfigurationError(argument, rows, "roll7, or all of rx, ry and rz, which say it already")
    return names
