"""Limits of chair and arm in one tick; the whole robot can always brake together without violating any limit."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.control.chair_obstacles import TIGHTER, ChairObstacles, mean_velocity
from rehab_opt.control.keep_out import ALONG, ArmKeepOuts
from rehab_opt.control.limit import PostureLimits, kept_within
from rehab_opt.control.linear_limit import LinearLimit, SymmetricLimit
from rehab_opt.control.obstacles import NUMBERS
from rehab_opt.control.stopping import FAR, OUTSIDE, BrakingTogether, velocity_bounds
from rehab_opt.kinematics.drive import Drive
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import Row
from rehab_opt.symbolic.tick import Stages

__all__ = ["ChairLimits", "Limits"]

TINY = 1e-12
FACETS = 8
"""Number of sides of the polygon that replaces the circle of allowed chassis velocities. The polygon lies inside the
circle; its corners lie on the axes.
"""


class Limits(NamedTuple):
    """Limits on the joint velocities u (n,) of one tick; the chair's are in the chassis frame.

    The velocity `base` (n,) satisfies all limits.
    """

    lower: ca.SX
    """(n,) lower bound of each joint's velocity, by its speed limit and by its position limits at the stop posture."""
    upper: ca.SX
    chassis: SymmetricLimit
    """Limit on the speeds of wheel rims and chassis [m/s]; empty for a fixed base."""
    towards: LinearLimit
    """Limit on the chair's speed towards obstacles [m/s], at the current posture and on the way to the stop posture."""
    closing: LinearLimit
    """Limit on the arm's speed towards keep-outs [m/s], at the current posture and on the way to the stop posture."""
    beside: LinearLimit
    """Limits of the user, and clearance."""
    base: ca.SX
    """(n,) fallback command: velocity after one tick in which all joints brake together as hard as possible. Near
    moving bodies see `ChairLimits`.
    """
    clearance: ca.SX
    """[m] distance of the arm from the nearest keep-out, negative inside."""
    nearest: ca.SX
    """[m] distance of the chair from the nearest obstacle, negative inside."""
    outside: ca.SX
    """1 if the state already violates a limit."""

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return sum(each.row_count for each in (self.chassis, self.towards, self.closing, self.beside))

    def surrounding_rows(self, u: ca.SX) -> list[Row]:
        """QP rows of obstacles, keep-outs, users' limits and clearance."""
        return [row for each in (self.towards, self.closing, self.beside) for row in each.rows(u)]

    def violation(self, u: ca.SX) -> ca.SX:
        """Norm of the violation of joint intervals and wheel limits by u (n,); infinite for NaN."""
        over = ca.vertcat(u - self.upper, self.lower - u, self.chassis.excess(u))
        return ca.if_else(all_true(ca.fabs(over) < ca.inf), ca.norm_2(ca.fmax(over, 0)), ca.inf)


class ChairLimits:
    """Compute the `Limits` of a tick.

    The stop posture z = q + T u of `BrakingTogether` satisfies each limit, so braking together violates none:

    - joint limits: lower <= q + T u <= upper;
    - keep-outs: the arm's least distance on the way to z, see `ArmKeepOuts`;
    - obstacles: the gap of each corner of the chair at z or half-way to z, whichever is smaller, see `ChairObstacles`.

    If a limit cannot be satisfied any more (an obstacle appears, a velocity is reset), the robot brakes as hard as the
    accelerations allow. A command that violates an obstacle, a keep-out or a user's limit is blended with braking, or
    with rest if that does not suffice (`kept`). Only the blend with rest relaxes the acceleration limit. While the
    stick commands a motion, the fallback command `base` moves away from approaching bodies.

    Parameters
    ----------
    robot, wheels : see `RedundancyResolver`. max_obstacles : largest number of obstacles. dt : tick [s].
    own : the user's limits, and clearance. recovery_speed : see `RedundancyResolver`.
    """

    def __init__(
        self,
        robot: MobileArm,
        wheels: Drive,
        *,
        max_obstacles: int,
        dt: float,
        recovery_speed: float,
        own: PostureLimits,
    ) -> None:
        self.robot, self.wheels, self.max_obstacles, self.own = robot, wheels, max_obstacles, own
        self.dt, self.recovery_speed = dt, recovery_speed
        self.braking = BrakingTogether(robot.chain, dt, moving=self.moving)
        self.obstacles = ChairObstacles(robot, self.braking, dt)
        self.keep_outs = ArmKeepOuts(robot, self.braking, dt)

    @property
    def moving(self) -> list[int]:
        """Indices of the joints that can move; the rolling constraint (Eq. 4) can exclude joints of the chair."""
        return [*self.wheels.moving, *range(CHAIR, self.robot.chain.n)]

    def limits(self, tick: Stages, q: ca.SX, last: ca.SX, surroundings: ca.SX, *, gives_way: ca.SX) -> Limits:
        """Limits at joint positions q (n,) after the command `last` (n,).

        `surroundings` holds the values of obstacles and moving capsules. If `gives_way` is 1, `base` moves away from
        approaching bodies.
        """
        lower, upper, hard_lower, hard_upper, outside = tick.once(self._joints(q, last))
        obstacles, told = ca.vertsplit(surroundings, [0, NUMBERS * self.max_obstacles, surroundings.numel()])
        towards, nearest = self.obstacles.limits(tick, obstacles, q, last)
        now, then, clearance = self.keep_outs.limits(tick, q, last)
        contacts = ca.SX(0, 1)
        if self.own.contacts_size:
            (contacts,) = tick.call(self.contacts, q, last, told)
        slowest = self.braking.slowest(last)
        chassis = self._chassis(slowest)
        base = clipped(slowest, hard_lower, hard_upper)
        beside = LinearLimit(ca.SX(0, q.numel()), ca.SX(0, 1))
        if len(self.own):
            turn = self.world(q[2], q.numel())
            turn[:, self.wheels.still()] = 0
            about, change = self.braking.slower(last), self.braking.change
            bodies = self._touched(tick, q, about, contacts, told, fastest=ca.fabs(last))
            ahead = LinearLimit(*self.own.on_the_way(
                q, about, bodies=bodies, way=self.led, seconds=self._times, change=change,
            ))  # fmt: skip
            ends = _reached(last, change, base, (lower, upper))
            led = kept_within((-ahead.matrix, ahead.upper, ca.SX.inf(ahead.row_count)), base, ends, ends)
            braked, base = base, ca.if_else(gives_way, led, base)
            *here, base = self.own.beside(
                q, turn @ last, contacts, turn=turn, base=base, ends=ends, hard=(hard_lower, hard_upper),
                gives_way=gives_way,
            )  # fmt: skip
            # From `braked` as far towards `base` as the wheels allow; both satisfy the acceleration limits.
            way = base - braked
            base = braked + chassis.one_sided.max_step_size(way, braked) * way
            beside = LinearLimit.stacked(LinearLimit(*here), ahead).relaxed(base)
            lower, upper = ca.fmin(lower, base), ca.fmax(upper, base)
            outside = ca.sum1(ca.vertcat(outside, self.own.beyond(q), self.own.inside(contacts))) > 0
        return Limits(
            lower=lower,
            upper=upper,
            chassis=chassis,
            towards=towards.relaxed(base),
            closing=LinearLimit.stacked(now, then).relaxed(base),
            beside=beside,
            base=base,
            clearance=clearance,
            nearest=nearest,
            outside=ca.sum1(ca.vertcat(outside, nearest < -OUTSIDE, clearance < 0)) > 0,
        )

    @staticmethod
    def world(heading: ca.SX, joints: int) -> ca.SX:
        """Matrix (n, n) that rotates velocities from the chassis frame to the world frame."""
        turn, cos, sin = ca.SX.eye(joints), ca.cos(heading), ca.sin(heading)
        turn[:2, :2] = ca.vertcat(ca.horzcat(cos, -sin), ca.horzcat(sin, cos))
        return turn

    def led(self, q: ca.SX, u: ca.SX, seconds: float) -> ca.SX:
        """Joint positions (n,) after `seconds` at velocities u (n,), the chair's in the chassis frame.

        The chair moves on an arc.
        """
        way = seconds * mean_velocity(np.zeros(2), u[:CHAIR], seconds)
        behind = q[2] - u[2] * self.dt / 2
        cos, sin = ca.cos(behind), ca.sin(behind)
        place = q[:2] + ca.vertcat(cos * way[0] - sin * way[1], sin * way[0] + cos * way[1])
        return ca.vertcat(place, q[2:] + seconds * u[2:])

    @cached_property
    def contacts(self) -> ca.Function:
        """CasADi function: q (n,), last u (n,), moving capsules -> contacts, see `PostureLimits.contacts`."""
        own, n = self.own, self.robot.chain.n
        here, last = ca.SX.sym("q", n), ca.SX.sym("last", n)
        sent = ca.Function("sent", [here, last], [self.world(here[2], n) @ last])
        inputs = [ca.MX.sym(name, size) for name, size in (("q", n), ("last", n), ("moving", own.moving_size))]
        return ca.Function("contacts", inputs, [own.contacts(inputs[0], sent(*inputs[:2]), inputs[2])])

    def _touched(self, tick: Stages, q: ca.SX, u: ca.SX, contacts: ca.SX, told: ca.SX, *, fastest: ca.SX) -> ca.SX:
        """`bodies_on_the_way` at the velocities u (n,); distances of `FAR` if all bodies are far away."""
        max_contacts = 0 if self.own.clearance is None else self.own.clearance.max_contacts
        none = ca.horzcat(FAR * ca.SX.ones(max_contacts), ca.SX.zeros(max_contacts, q.numel()))
        if not max_contacts:
            return none
        way = self.braking.time * (1 + self.robot.reach) * ca.sum1(fastest + self.braking.change)
        return tick.when(contacts[-1] <= way, lambda: tick.call(self.bodies_on_the_way, q, u, told)[0], none)

    @cached_property
    def bodies_on_the_way(self) -> ca.Function:
        """`PostureLimits.bodies_on_the_way` for chair and arm."""
        return self.own.bodies_on_the_way(way=self.led, seconds=self._times[1::2], change=self.braking.change)

    @cached_property
    def _times(self) -> list[float]:
        """Times [s] after which a constant velocity reaches the fractions `ALONG` of the way to the stop posture."""
        return [part * self.braking.time for part in ALONG]

    def kept(self, tick: Stages, q: ca.SX, surroundings: ca.SX, limits: Limits, u: ca.SX) -> ca.SX:
        """Velocities u (n,), blended with `limits.base` as far as needed.

        The result moves the robot no deeper into an obstacle or keep-out, and no further beyond a user's limit.
        """
        if not (self.max_obstacles or self.robot.keep_out or len(self.own)):
            return u
        u = tick.once(u)

        def judged() -> ca.SX:
            return tick.call(self._first_kept, q, surroundings, u, limits.base)[0]

        if len(self.own):
            return judged()
        driven = self.dt * self.obstacles.fastest(u) < limits.nearest
        return tick.when(ca.logic_and(driven, self.keep_outs.clear(u, limits.clearance)), u, judged)

    @cached_property
    def _first_kept(self) -> ca.Function:
        own, n, obstacles = self.own, self.robot.chain.n, NUMBERS * self.max_obstacles
        sizes = (("q", n), ("surroundings", obstacles + own.moving_size), ("u", n))
        q, around, u = inputs = [ca.MX.sym(name, size) for name, size in sizes]
        here, velocity, told = ca.SX.sym("q", n), ca.SX.sym("u", n), ca.SX.sym("obstacles", obstacles)
        sent = ca.Function("sent", [here, velocity], [self.world(here[2], n) @ velocity])
        out = all_true(
            self.keep_outs.no_deeper(here[CHAIR:], velocity), self.obstacles.keeps_out(told, here[:CHAIR], velocity)
        )
        verdict = ca.Function("out", [here, velocity, told], [out], {"cse": True})(q, u, around[:obstacles])
        if len(own):
            verdict = ca.logic_and(verdict, own.judged(q, around[obstacles:], sent(q, u)))
        return own.first_kept(ca.Function("judged", inputs, [verdict]))

    def _joints(self, q: ca.SX, last: ca.SX) -> tuple[ca.SX, ...]:
        chain, time, slowest = self.robot.chain, self.braking.time, self.braking.slowest(last)
        bounds = velocity_bounds(chain, q, last, dt=self.dt, recovery_speed=self.recovery_speed)
        up, down = (ca.fmax(room, 0) / time for room in (ca.DM(chain.upper) - q, q - ca.DM(chain.lower)))
        upper = ca.fmin(ca.fmax(up, slowest), bounds.hard_upper)
        lower = ca.fmax(ca.fmin(-down, slowest), bounds.hard_lower)
        # The chair's positions have no limits, so its intervals are constants.
        speed = ca.DM([chain.velocity[i] if i in self.moving else 0.0 for i in range(CHAIR)])
        ends, hard = (lower, upper), (bounds.hard_lower, bounds.hard_upper)
        pairs = [(ca.vertcat(-speed, a[CHAIR:]), ca.vertcat(speed, b[CHAIR:])) for a, b in (ends, hard)]
        return *pairs[0], *pairs[1], bounds.outside

    def _chassis(self, slowest: ca.SX) -> SymmetricLimit:
        """Limits on rim speeds and chassis speed; the polygon of the chassis speed contains the hardest braking."""
        chain, (rows, upper) = self.robot.chain, self.wheels.rims
        rims = SymmetricLimit.of_joints(0, chain.n, ca.sparsify(ca.SX(rows)), ca.SX(upper * (1 - TIGHTER)))
        if not self.wheels.holonomic:
            return rims
        speed = float(chain.velocity[0]) * (1 - TIGHTER)
        angles = (np.arange(FACETS // 2) + 0.5) * 2 * np.pi / FACETS
        sides = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        inner = speed * math.cos(np.pi / FACETS)
        needed = ca.fmax(ca.fabs(ca.DM(sides) @ slowest[:CHAIR]), inner)
        across = ca.vertcat(needed[FACETS // 4 :], needed[: FACETS // 4])
        room = ca.sqrt(ca.fmax(speed**2 - across**2, 0))
        limits = ca.if_else(across > inner, ca.fmin(needed, room), needed)
        polygon = SymmetricLimit.of_joints(0, chain.n, ca.sparsify(ca.SX(sides)), limits)
        return SymmetricLimit.stacked(rims, polygon)


def _reached(last: ca.SX, change: ca.DM, base: ca.SX, ends: tuple[ca.SX, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Velocities inside `ends` that differ from `last` by at most `change`; the interval also includes `base`."""
    lower, upper = (clipped(end, *ends) for end in (last - change, last + change))
    return ca.fmin(lower, base), ca.fmax(upper, base)
