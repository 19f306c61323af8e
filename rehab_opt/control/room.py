"""How fast chair and arm may move whatever is asked: speeds, wheels, position limits, obstacles and keep-outs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.control.keep_out import closing_rows
from rehab_opt.control.obstacles import NUMBERS, approach
from rehab_opt.control.stopping import FAR, velocity_bounds
from rehab_opt.kinematics.differential import Differential
from rehab_opt.kinematics.mecanum import Mecanum
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.qp import Row, within

__all__ = ["Room", "Surroundings", "largest_share"]

TIGHTER = 1e-7
"""Share by which row limits are drawn in, so that what a certificate may leave open never passes them."""
SLACK = 1.1
"""By how much longer the barriers count than stopping takes: the direction of an obstacle changes on the way."""
GENTLY = 0.7
"""Share of its acceleration with which a joint stops before its limit: with nothing left, the hand would have to wait
until that joint has stopped."""
TINY = 1e-12
FACETS = 8
"""Sides of the polygon inside the circle of chassis velocities; its corners lie on the axes."""


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
    clearance: ca.SX
    """[m] of the arm from the nearest keep-out, negative inside."""
    outside: ca.SX
    """1 where the state is beyond one of them already."""

    @property
    def row_count(self) -> int:
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
        changing = ("lower", "upper", "towards", "towards_limit", "closing", "closing_limit", "clearance", "outside")
        return {name: ca.vec(ca.densify(getattr(self, name))) for name in changing}

    def like(self, given: Mapping[str, ca.SX]) -> Room:
        """The same with those columns as symbols."""
        return self._replace(**{name: ca.reshape(given[name], *getattr(self, name).shape) for name in self.columns()})

    def share_of(self, u: ca.SX) -> ca.SX:
        """Largest share of u, at most all of it, that keeps the bounds."""
        chair, arm = self.chair @ u[:CHAIR], u[CHAIR:]
        return ca.fmin(
            ca.fmin(largest_share(u, self.upper), largest_share(-u, -self.lower)),
            ca.fmin(
                largest_share(ca.fabs(chair), self.chair_limit),
                ca.fmin(
                    largest_share(self.towards @ u[:CHAIR], self.towards_limit),
                    largest_share(self.closing @ arm, self.closing_limit),
                ),
            ),
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


def largest_share(values: ca.SX, limits: ca.SX) -> ca.SX:
    """Largest share, at most 1, of values that does not pass the limits, zero or more."""
    if not values.numel():
        return ca.SX(1)
    return ca.fmin(1, ca.mmin(ca.if_else(values > limits, limits / ca.fmax(values, TINY), 1)))


class Surroundings:
    """What `Room` is made from; `slots` obstacles may be around."""

    def __init__(
        self, robot: MobileArm, wheels: Mecanum | Differential, *, slots: int, dt: float, return_speed: float
    ) -> None:
        self.robot, self.wheels, self.slots = robot, wheels, slots
        self.dt, self.return_speed = dt, return_speed
        self._chair, self._arm = slice(CHAIR), slice(CHAIR, robot.chain.n)

    @property
    def skin(self) -> float:
        """[m] by which a link's end may leave its straight way within a tick, at the arm's largest speeds."""
        chain = self.robot.chain
        reach = abs(chain.rows[4].d) + abs(chain.rows[6].d)
        return reach * float(np.sum(chain.velocity[CHAIR:]) * self.dt) ** 2 / 2

    @property
    def moving(self) -> list[int]:
        """Joints that the wheels allow to move, by number from 0: Eq. (4) in the chassis frame."""
        return [i for i in range(self.robot.chain.n) if isinstance(self.wheels, Mecanum) or i != 1]

    def room(self, q: ca.SX, last: ca.SX, obstacles: ca.SX) -> Room:
        """Room at joint values q (7,) after the command `last` (7,), with obstacles (4 slots,)."""
        lower, upper, outside = self._joints(q, last)
        towards, towards_limit, within_one = self._obstacles(q, last, obstacles)
        closing, closing_limit, gaps = self._keep_outs(q, last)
        chair, chair_limit = self._chassis()
        return Room(
            lower=lower,
            upper=upper,
            chair=chair,
            chair_limit=chair_limit,
            towards=towards,
            towards_limit=towards_limit,
            closing=closing,
            closing_limit=closing_limit,
            clearance=ca.mmin(gaps) if gaps.numel() else ca.SX(FAR),
            outside=ca.sum1(ca.vertcat(outside, within_one, gaps < 0)) > 0,
        )

    def _joints(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        chain = self.robot.chain
        bounds = velocity_bounds(chain, q, last, dt=self.dt, return_speed=self.return_speed)
        gentle = chain.with_limits(acceleration=GENTLY * chain.acceleration)
        stop = velocity_bounds(gentle, q, last, dt=self.dt, return_speed=self.return_speed)
        # A joint that can no longer stop in time brakes as hard as it may, and is held by the limit itself.
        upper = ca.fmax(ca.fmax(ca.fmin(stop.stop_upper, bounds.hard_upper), bounds.brake_lower), 0)
        lower = ca.fmin(ca.fmin(ca.fmax(stop.stop_lower, bounds.hard_lower), bounds.brake_upper), 0)
        # Positions of the chair are not bounded: its intervals are numbers.
        speed = ca.DM([chain.velocity[i] if i in self.moving else 0.0 for i in range(CHAIR)])
        return ca.vertcat(-speed, lower[CHAIR:]), ca.vertcat(speed, upper[CHAIR:]), bounds.outside

    def _chassis(self) -> tuple[ca.SX, ca.SX]:
        """Rim speeds, and the polygon of chassis speeds where there are two of them."""
        wheels, speed = self.wheels, float(self.robot.chain.velocity[0])
        rows, limits = [wheels.radius * wheels.rolling], [np.full(len(wheels.rolling), wheels.radius * wheels.limit)]
        if isinstance(wheels, Mecanum):
            angles = (np.arange(FACETS // 2) + 0.5) * 2 * np.pi / FACETS
            rows.append(np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1))
            limits.append(np.full(angles.size, speed * math.cos(np.pi / FACETS)))
        return ca.sparsify(ca.SX(ca.DM(np.vstack(rows)))), ca.SX(ca.DM(np.concatenate(limits) * (1 - TIGHTER)))

    def _obstacles(self, q: ca.SX, last: ca.SX, numbers: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        outline, turn = self.robot.outline, float(self.robot.chain.velocity[2])
        horizon, slowed = self._stopping_time(self._chair), self._slowed(last, self._chair)
        rows, limits, inside = [ca.SX(0, CHAIR)], [ca.SX(0, 1)], [ca.SX(0, 1)]
        for i in range(self.slots):
            one = numbers[NUMBERS * i : NUMBERS * (i + 1)]
            each = approach(one, q[:CHAIR], outline, dt=self.dt, horizon=horizon, turn=turn)
            room, most = (limit * (1 - TIGHTER) for limit in (each.room, each.room + each.more))
            rows.append(each.matrix)
            # What the hardest braking leaves is allowed, but not to go in: accelerations yield only where they must.
            limits.append(ca.fmax(room, ca.fmin(each.matrix @ slowed, most)))
            inside.append(each.inside)
        return ca.vertcat(*rows), ca.vertcat(*limits), ca.vertcat(*inside)

    def _keep_outs(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        if not self.robot.keep_out:
            return ca.SX(0, self.robot.chain.n - CHAIR), ca.SX(0, 1), ca.SX(0, 1)
        opening, gaps = closing_rows(self.robot, q[CHAIR:])
        free, slowed = ca.fmax(gaps - self.skin, 0), -opening @ self._slowed(last, self._arm)
        return -opening, ca.fmax(free / self._stopping_time(self._arm), ca.fmin(slowed, free / self.dt)), gaps

    def _stopping_time(self, joints: slice) -> float:
        """[s] that joints at their largest speeds need to stop, all slowing down in proportion, in whole ticks."""
        chain = self.robot.chain
        return (
            SLACK * self.dt * max(1.0, float(np.max(chain.velocity[joints] / (chain.acceleration[joints] * self.dt))))
        )

    def _slowed(self, last: ca.SX, joints: slice) -> ca.SX:
        """What the hardest braking in proportion leaves of the last command's joints."""
        chain = self.robot.chain
        allowed = ca.DM(np.minimum(chain.acceleration * self.dt, 2 * chain.velocity)[joints])
        ticks = ca.mmax(ca.fabs(last[joints]) / allowed)
        return last[joints] * ca.fmax(0, 1 - 1 / ca.fmax(ticks, 1))
