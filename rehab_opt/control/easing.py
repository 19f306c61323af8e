"""From the last command to a wanted one within accelerations, without leaving the bounds of chair and arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.control.keep_out import arm_gaps
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.qp import Row, within

__all__ = ["Easing", "Room"]

SHORTER = (1.0, 0.5, 0.25)
"""Shares of a step that are tried where the arm's true way would lead into a keep-out."""
TINY = 1e-12
ENOUGH = 1.0 - 1e-12
"""Share of the way that is all of it."""


class Room(NamedTuple):
    """Bounds on chair and arm velocities u (7,) that never yield, the chair's in its own frame; u = 0 keeps them."""

    lower: ca.SX
    """(7,) of each joint alone: speed, and where it could still stop at its position limit."""
    upper: ca.SX
    chair: ca.SX
    """(a, 3) rows of rim speeds and of the chassis speed, both ways within chair_limit (a,) [m/s]."""
    chair_limit: ca.SX
    towards: ca.SX
    """(b, 3) rows towards obstacles, at most towards_limit (b,) [m/s]."""
    towards_limit: ca.SX
    closing: ca.SX
    """(c, 4) rows of the arm towards its keep-outs, at most closing_limit (c,) [m/s]."""
    closing_limit: ca.SX
    outside: ca.SX
    """1 where the state is beyond one of them already."""

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.chair.size1() + self.towards.size1() + self.closing.size1())

    def rows(self, u: ca.SX) -> list[Row]:
        """The rows as a statement wants them."""
        chair, arm = u[:CHAIR], u[CHAIR:]
        rows = [within(self.chair @ chair, -self.chair_limit, self.chair_limit)]
        if self.towards.size1():
            rows.append(within(self.towards @ chair, -np.inf, self.towards_limit))
        if self.closing.size1():
            rows.append(within(self.closing @ arm, -np.inf, self.closing_limit))
        return rows

    def columns(self) -> dict[str, ca.SX]:
        """What changes from tick to tick, each as one column."""
        changing = ("lower", "upper", "towards", "towards_limit", "closing", "closing_limit", "outside")
        return {name: ca.vec(ca.densify(getattr(self, name))) for name in changing}

    def like(self, given: Mapping[str, ca.SX]) -> Room:
        """The same with those columns as symbols."""
        return self._replace(
            **{name: ca.reshape(given[name], *getattr(self, name).shape) for name in self.columns()}
        )

    def violation(self, u: ca.SX) -> ca.SX:
        """By how much u breaks them; infinite for NaN."""
        chair, arm = u[:CHAIR], u[CHAIR:]
        over = ca.vertcat(
            u - self.upper,
            self.lower - u,
            ca.fabs(self.chair @ chair) - self.chair_limit,
            self.towards @ chair - self.towards_limit,
            self.closing @ arm - self.closing_limit,
        )
        return ca.if_else(all_true(ca.fabs(over) < ca.inf), ca.norm_2(ca.fmax(over, 0)), ca.inf)


class Easing:
    """The way from the last command to a wanted one, both with the chair's velocity in its own frame.

    It begins at the last command where that keeps the bounds, else at what is left of it when everything slows down
    in proportion and each joint alone as much as it must. The wanted one keeps the bounds, and so does every point
    between: as far as the accelerations allow, or all of it. Where the beginning itself is beyond an acceleration,
    the bounds have overruled it.
    """

    def __init__(self, robot: MobileArm, dt: float, room: Room, *, base: ca.SX | None = None) -> None:
        self.robot, self.dt, self.room, self._base = robot, dt, room, base
        chain = robot.chain
        self._allowed = ca.DM(np.minimum(chain.acceleration * dt, 2 * chain.velocity))

    def base_of(self, last: ca.SX) -> ca.SX:
        """(7,) where the way begins."""
        kept = self._pressed_in(last)
        slower = self._pressed_in(last * ca.fmax(0, 1 - 1 / ca.fmax(ca.mmax(ca.fabs(last) / self._allowed), 1)))
        return ca.if_else(ca.sumsqr(kept - last) <= 0, last, slower)

    def towards(self, last: ca.SX, wanted: ca.SX, arm: ca.SX) -> ca.SX:
        """(7,) command on the way from `last` to `wanted` (7,), with the arm at `arm` (4,)."""
        base = self.base_of(last) if self._base is None else self._base
        eased = self._part_way(last, base, wanted, slice(None))
        if not self.robot.keep_out:
            return eased
        share, chair = self._unhindered(eased[CHAIR:], arm), slice(CHAIR)
        slower = self._part_way(last, eased, share * eased, chair)  # the chair waits for the arm as soon as it may
        return ca.vertcat(slower, share * eased[CHAIR:])

    def _part_way(self, last: ca.SX, begin: ca.SX, end: ca.SX, joints: slice) -> ca.SX:
        """As far from `begin` to `end` as the accelerations of the joints allow, or all the way."""
        last, begin, end, allowed = last[joints], begin[joints], end[joints], self._allowed[joints]
        way = end - begin
        ahead = ca.fmax(last + allowed, begin) - begin
        behind = begin - ca.fmin(last - allowed, begin)
        size = ca.fabs(way)
        free = ca.if_else(size > TINY, ca.if_else(way > 0, ahead, behind) / ca.fmax(size, TINY), 1)
        share = ca.mmin(free)
        return ca.if_else(share >= ENOUGH, end, begin + share * way)

    def _pressed_in(self, u: ca.SX) -> ca.SX:
        """The nearest to u, joint by joint and then in proportion, that keeps all bounds."""
        room = self.room
        joints = clipped(u, room.lower, room.upper)
        chair = joints[:CHAIR] * _share(room.towards @ joints[:CHAIR], room.towards_limit)
        arm = joints[CHAIR:] * _share(room.closing @ joints[CHAIR:], room.closing_limit)
        return ca.vertcat(chair, arm)

    def _unhindered(self, velocity: ca.SX, arm: ca.SX) -> ca.SX:
        """Largest of `SHORTER` with which no link goes into a keep-out, or deeper; zero if none.

        The rows of the QP say so to first order, which is not enough where a link slides along a keep-out.
        """
        now, largest = ca.fmin(arm_gaps(self.robot, arm), 0), ca.SX(0)
        for share in reversed(SHORTER):
            then = arm_gaps(self.robot, arm + share * self.dt * velocity)
            largest = ca.if_else(all_true(then >= now), share, largest)
        return largest


def _share(values: ca.SX, limits: ca.SX) -> ca.SX:
    """Largest share, at most 1, of values that does not pass the limits, zero or more."""
    if not values.numel():
        return ca.SX(1)
    return ca.fmin(1, ca.mmin(ca.if_else(values > limits, limits / ca.fmax(values, TINY), 1)))
