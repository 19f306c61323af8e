"""Bounds of a hand-holding arm besides its joints': manipulability floor, hand speed, keep-out planes, deviation.

Each is stated twice. As a row R q' <= r of the QP, linear about the present state, that slows the approach to the bound
exponentially, and leads away from it again where the tangent would promise too much (`Limits.falls`). And as a
condition on the true state at the end of the tick, `kept`: the rows are about a tangent. The hand speed holds at every
instant of the tick (`tool_speed`), the others at its ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.clearance_pairs import ClearancePairs
from rehab_opt.control.guarded_points import GuardedPoint, guarded_points
from rehab_opt.control.limit import Limit, Limits
from rehab_opt.control.stopping import VelocityBounds, nearest_to_rest
from rehab_opt.control.tool_speed import tool_jerk
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import KeepOut
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["HandBounds", "KeepOut", "feasible_rows"]

Array = NDArray[np.float64]

FREE = 1e3
"""[m/s] A row that is not felt."""
SHARE = 0.9
"""Share of what the joints can do that recovery may ask for: the rest is for the task."""
ABOVE = 5e-5
"""Of w / w_max, above the floor where the tangents' barrier lies: sliding along it needs no step shortened."""
ROUNDING, TINY = 1e-12, 1e-12
PASSES = 2
"""Over all rows, in which a velocity is looked for that leads away where it has to."""


class Now(NamedTuple):
    """What holds at the beginning of a tick, in expressions."""

    w: ca.SX
    """W / w_max."""
    gradient: ca.SX
    """(n,) of it."""
    pose: ca.SX
    """(4, 4) of the tool."""


@dataclass(frozen=True, eq=False)
class HandBounds:
    """The bounds of one arm as expressions.

    Parameters
    ----------
    chain : the arm.
    floor : least manipulability, as a share of `max_manipulability`.
    max_manipulability : largest manipulability of the arm.
    linear_speed : [m/s] of the tool's origin, its true norm.
    deviation : [m] largest distance of the tool's origin from the reference.
    planes : what to stay out of, with the chain's capsules, its tool's origin and the origins of its frames, as far as
        joints move them (`guarded_points`).
    rate : [1/s] at which the distance to a bound may decay.
    dt : tick [s].
    recovery_speed : share of the joints' speeds at which the arm is led back above the floor.
    limits : a user's own.
    margin : [m] that is left before planes and bodies at least, where they may be gone into by what joints are led
        astray.
    clearance : pairs of bodies that keep clear of each other, or None.
    """

    chain: SerialChain
    floor: float
    max_manipulability: float
    linear_speed: float
    deviation: float
    planes: Sequence[KeepOut]
    rate: float
    dt: float
    recovery_speed: float
    limits: Sequence[Limit] = ()
    margin: float = 0.0
    clearance: ClearancePairs | None = None

    @property
    def count(self) -> int:
        """Number of rows."""
        return 2 + len(self.distances)

    @cached_property
    def distances(self) -> Limits:
        """What the arm keeps to the planes, a user's own limits, and clearance."""
        planes = [Limit(partial(self._above, plane)) for plane in self.planes]
        own = [each if each.rate is not None else replace(each, rate=self.rate) for each in (*planes, *self.limits)]
        return Limits(
            own, self.chain, self.dt, self.clearance, recovery_speed=self.recovery_speed, fastest_rate=self.rate
        )

    @property
    def _margins(self) -> list[float]:
        """[m] for every row of `distances`: none of a user's own limits, whose units are not known."""
        planes = len(self.planes) * min(len(self.guarded), 2)
        bodies = 0 if self.clearance is None else self.clearance.slots
        others = len(self.distances) - planes - bodies
        return [self.margin] * planes + [0.0] * others + [self.margin] * bodies

    def _above(self, plane: KeepOut, _: SerialChain, q: ca.SX) -> ca.SX:
        return ca.vertcat(*self.heights(self.chain.frames_expression(q), plane))

    @cached_property
    def guarded(self) -> tuple[GuardedPoint, ...]:
        """What stays out of the planes."""
        return guarded_points(self.chain)

    def manipulability(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """W / w_max and its gradient (n,)."""
        w, gradient = self.chain.manipulability_expression(q), self.chain.manipulability_gradient_expression(q)
        return w / self.max_manipulability, gradient / self.max_manipulability

    def rows(
        self,
        q: ca.SX,
        last: ca.SX,
        *,
        centre: ca.SX,
        lead: ca.SX,
        loss: ca.SX,
        bounds: VelocityBounds,
        contacts: ca.SX,
        strays: ca.SX | None = None,
    ) -> tuple[ca.SX, ca.SX, VelocityBounds, Now]:
        """R (m, n), r (m,), the joint intervals, opened where the acceleration bound has to yield, and how things are.

        Parameters
        ----------
        q, last : (n,) joint positions, and their velocity in the last tick.
        centre : (3,) [m] the reference.
        lead : (n,) stands for the gradient of w where that vanishes, else zero.
        loss : what the last tick lost of w / w_max against its tangent: counted on again.
        bounds : of the joint velocities.
        contacts : the nearest, see `Limits.contacts`.
        strays : (n,) from q, where the joints are led, to where they are. Floor, planes and a user's limits have room
            for it either way, joint by joint: what friction holds back on the way in, it holds back on the way out.
            None for joints that move as commanded.
        """
        astray = None if strays is None else ca.fabs(strays)
        share = (1 - math.exp(-self.rate * self.dt)) / self.dt
        w, slope_of_w = self.manipulability(q)
        gradient = slope_of_w + lead
        climb = share * (self.floor + ABOVE - w) + loss / self.dt
        if astray is not None:
            climb += share * ca.dot(ca.fabs(slope_of_w), astray)
        frames = self.chain.frames_expression(q)
        pose = frames[-1]
        normals, most = [], []
        away = pose[:3, 3] - centre
        distance = ca.norm_2(away)
        unit = away / ca.fmax(distance, 1e-9)
        far = distance > 0.25 * self.deviation  # a row at the very centre has no direction
        normals.append(unit.T @ self.chain.jacobian_expression(q)[:3, :])
        most.append(ca.if_else(far, share * ca.fmax(self.deviation - distance, 0), FREE))
        margins = ca.DM(self._margins)

        def room(slopes: ca.SX, which: slice) -> ca.SX:
            return ca.fmax(ca.fabs(slopes) @ astray, margins[which])

        slopes, falls, hard = self.distances.falls(q, last, contacts, room=None if astray is None else room)
        normals.append(-slopes)
        most.append(falls)
        bounds = bounds._replace(outside=ca.logic_or(bounds.outside, self.distances.inside(contacts)))
        slow = ca.DM(self.recovery_speed * self.chain.velocity)
        calm = ca.dot(ca.fabs(gradient), slow)
        rows = feasible_rows(
            gradient, climb, calm=calm, normals=ca.vertcat(*normals), most=ca.vertcat(*most), bounds=bounds,
            hard=hard,
        )  # fmt: skip
        return *rows, Now(w, slope_of_w, pose)

    def kept(
        self, q: ca.SX, velocity: ca.SX, centre: ca.SX, *, w: ca.SX, here: ca.SX, hand: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Whether the true state after the tick keeps every bound; and w / w_max then.

        What is broken already must not get worse. `w`, `here` (3,) and `hand` (3,) are w / w_max and the tool's origin
        at q and its velocity.
        """
        ahead = q + velocity * self.dt
        then = self.chain.manipulability_expression(ahead) / self.max_manipulability
        there = self.chain.pose_expression(ahead)[:3, 3]
        fast = [ca.norm_2(each) for each in (hand, self.chain.jacobian_expression(ahead)[:3, :] @ velocity)]
        reach = self.linear_speed * (1 + 1e-9) - self.dt**2 / 8 * tool_jerk(self.chain, q, velocity, self.dt)
        before, after = ca.norm_2(here - centre), ca.norm_2(there - centre)
        conditions = [
            then >= ca.fmin(w, self.floor) - ROUNDING,
            *(each <= reach for each in fast),
            after <= ca.fmax(before, self.deviation) + ROUNDING,
        ]
        for plane in self.planes:
            now, later = (self.heights(self.chain.frames_expression(at), plane) for at in (q, ahead))
            conditions += [b >= ca.fmin(a, 0) - ROUNDING for a, b in zip(now, later, strict=True)]
        if self.limits:
            conditions.append(Limits(self.limits, self.chain, self.dt).kept(q, velocity))
        return all_true(*conditions), then

    def least_height(self, q: Array, plane: KeepOut) -> float:
        """[m] of what is guarded above a plane at q (n,); negative where the arm is in the keep-out."""
        symbol = ca.SX.sym("q", self.chain.n)
        heights = ca.vertcat(*self.heights(self.chain.frames_expression(symbol), plane))
        return float(ca.Function("height", [symbol], [ca.mmin(heights)])(q))

    def heights(self, frames: list[ca.SX], plane: KeepOut) -> list[ca.SX]:
        """[m] of each guarded point's ball above a plane."""
        normal = ca.DM(plane.normal)
        return [
            ca.dot(normal, centre) - (plane.offset + point.radius)
            for point, centre in zip(self.guarded, self._centres(frames), strict=True)
        ]

    def _centres(self, frames: list[ca.SX]) -> list[ca.SX]:
        """(3,) [m] of each guarded point."""
        return [frames[i][:3, :3] @ ca.sparsify(ca.DM(offset)) + frames[i][:3, 3] for i, offset, _ in self.guarded]


def feasible_rows(
    gradient: ca.SX,
    climb: ca.SX,
    *,
    calm: ca.SX,
    normals: ca.SX,
    most: ca.SX,
    bounds: VelocityBounds,
    hard: ca.SX,
) -> tuple[ca.SX, ca.SX, VelocityBounds]:
    """Rows that some velocity within the (perhaps opened) intervals satisfies, always.

    The floor's row asks for gradient . q' >= climb; where that is positive, at most for `calm`, and for what the joints
    can do in this tick. The others are `normals` q' <= `most`, of which the last, as many as
    `hard` has, may be below zero. The witness is the velocity nearest to rest, moved towards the fastest climb as far
    as the floor asks, then across each row that is below zero, past the floor's, beyond the intervals only for what
    `hard` asks for, and scaled down as far as the other rows ask. Where it leaves the intervals, they are opened up to
    it: the acceleration yields, no more than that. Below zero, and of the floor, no more is asked than the witness
    does.
    """
    lower, upper = bounds.lower, bounds.upper
    rest = nearest_to_rest(bounds._replace(brake_lower=lower, brake_upper=upper))
    fastest = ca.if_else(gradient > 0, upper, lower)
    slope, most_climb = ca.dot(gradient, rest), ca.dot(gradient, fastest)
    asked = ca.if_else(climb > 0, ca.fmin(ca.fmin(climb, calm), SHARE * ca.fmax(most_climb, 0)), climb)
    part = clipped((asked - slope) / ca.fmax(most_climb - slope, 1e-12), 0, 1)
    towards = rest + part * (fastest - rest)
    slowed = fastest * clipped(asked / ca.fmin(most_climb, -1e-12), 0, 1)
    witness = ca.if_else(slope >= asked, rest, ca.if_else(most_climb >= asked, towards, slowed))
    low, high = ca.fmin(lower, witness), ca.fmax(upper, witness)
    leading = hard.numel()
    lead = range(most.numel() - leading, most.numel())
    pushes = [_past(normals[i, :].T, gradient) for i in lead]
    for i, push in list(zip(lead, pushes, strict=True)) * min(leading, PASSES):
        over = ca.if_else(most[i] < 0, ca.fmax(normals[i, :] @ witness - most[i], 0), 0)
        witness = clipped(witness - over * push, low, high)
    for i, push, least in list(zip(lead, pushes, ca.vertsplit(hard), strict=True)) * PASSES:
        if not least.is_constant():
            over = ca.fmax(normals[i, :] @ witness - least, 0)
            witness = clipped(witness - over * push, *bounds.hard)
    speeds, share = normals @ witness, ca.SX(1)
    for i in range(most.numel()):
        least = ca.fmax(most[i], 0) if i in lead else most[i]
        share = ca.fmin(share, ca.if_else(speeds[i] > least, least / ca.fmax(speeds[i], TINY), 1))
    witness = share * witness
    least, most = ca.fmin(asked, ca.dot(gradient, witness)), ca.SX(most)
    for i in lead:
        most[i] = ca.if_else(most[i] < 0, ca.fmax(most[i], share * speeds[i]), most[i])
    rows = ca.vertcat(-gradient.T, normals)
    opened = bounds._replace(lower=ca.fmin(lower, witness), upper=ca.fmax(upper, witness))
    return rows, ca.vertcat(-least, most), opened


def _past(normal: ca.SX, gradient: ca.SX) -> ca.SX:
    """(n,) that leads by 1 along `normal` and not along `gradient`; as far as they differ."""
    push = normal - gradient * (ca.dot(normal, gradient) / ca.fmax(ca.sumsqr(gradient), TINY))
    return push / ca.fmax(ca.dot(normal, push), TINY)
