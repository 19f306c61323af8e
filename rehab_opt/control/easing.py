"""From the last command to a wanted one within accelerations, without leaving the bounds of chair and arm."""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.control.keep_out import arm_gaps
from rehab_opt.control.room import Room, largest_share
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["Easing"]

SHORTER = (1.0, 0.5, 0.25)
"""Shares of a step that are tried where the arm's true way would lead into a keep-out."""
TINY = 1e-12
ROUNDED = 1.01
"""By how much more a step is taken to move the arm than it can."""
ENOUGH = 1.0 - 1e-12
"""Share of the way that is all of it."""


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

    def keeps(self, last: ca.SX) -> ca.SX:
        """1 where the last command keeps the bounds: there the way begins."""
        room = self.room
        towards, closing = room.towards @ last[:CHAIR], room.closing @ last[CHAIR:]
        return all_true(
            last >= room.lower, last <= room.upper, towards <= room.towards_limit, closing <= room.closing_limit
        )

    def slower(self, last: ca.SX) -> ca.SX:
        """(7,) where the way begins otherwise."""
        return self._pressed_in(last * ca.fmax(0, 1 - 1 / ca.fmax(ca.mmax(ca.fabs(last) / self._allowed), 1)))

    def towards(self, last: ca.SX, wanted: ca.SX, arm: ca.SX) -> ca.SX:
        """(7,) command on the way from `last` to `wanted` (7,), with the arm at `arm` (4,)."""
        eased = self.eased(last, wanted)
        return self.waiting(last, eased, self.unhindered(eased[CHAIR:], arm)) if self.robot.keep_out else eased

    def eased(self, last: ca.SX, wanted: ca.SX) -> ca.SX:
        """(7,) the same as far as accelerations go."""
        base = ca.if_else(self.keeps(last), last, self.slower(last)) if self._base is None else self._base
        return self._part_way(last, base, wanted, slice(None))

    def waiting(self, last: ca.SX, eased: ca.SX, share: ca.SX) -> ca.SX:
        """(7,) that with only a share of the arm's step; the chair waits for the arm as soon as it may."""
        return ca.vertcat(self._part_way(last, eased, share * eased, slice(CHAIR)), share * eased[CHAIR:])

    def clear(self, velocity: ca.SX) -> ca.SX:
        """1 where the keep-outs are too far away for a step of the arm with `velocity` (4,) to end in one."""
        chain = self.robot.chain
        reach = abs(chain.rows[4].d) + abs(chain.rows[6].d)
        return self.room.clearance > ROUNDED * reach * self.dt * ca.sum1(ca.fabs(velocity)) + TINY

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
        chair = joints[:CHAIR] * largest_share(room.towards @ joints[:CHAIR], room.towards_limit)
        arm = joints[CHAIR:] * largest_share(room.closing @ joints[CHAIR:], room.closing_limit)
        return ca.vertcat(chair, arm)

    def unhindered(self, velocity: ca.SX, arm: ca.SX) -> ca.SX:
        """Largest of `SHORTER` with which no link goes into a keep-out, or deeper; zero if none.

        The rows of the QP say so to first order, which is not enough where a link slides along a keep-out.
        """
        now, largest = ca.fmin(arm_gaps(self.robot, arm), 0), ca.SX(0)
        for share in reversed(SHORTER):
            then = arm_gaps(self.robot, arm + share * self.dt * velocity)
            largest = ca.if_else(all_true(then >= now), share, largest)
        return largest
