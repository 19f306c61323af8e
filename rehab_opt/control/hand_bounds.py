"""Bounds of a hand-holding arm besides its joints': manipulability floor, hand speed, keep-out planes, deviation.

Each is stated twice. As a row R q' <= r of the QP, linear about the present state, that slows the approach to the bound
exponentially, and leads away from it again where the tangent would promise too much (`PostureLimits.falls`). And as a
condition on the true state at the end of the tick, `kept`: the rows are about a tangent. The hand speed holds at every
instant of the tick (`tool_speed`), and at the end of one of braking behind it, the others at its ends; those of place
and posture also on the way to rest of an arm that brakes from there on, so that what is kept in a tick can be kept in
all that follow, within the accelerations.
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
from rehab_opt.control.limit import ROWS, Limit, PostureLimits
from rehab_opt.control.stopping import VelocityBounds, max_change, slowed_together, ticks_to_rest
from rehab_opt.control.tool_speed import tool_jerk
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import KeepOut
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["GuardedPoint", "HandBounds", "KeepOut", "feasible_rows", "guarded_points"]

Array = NDArray[np.float64]

SAMPLES = 5
"""Random postures: balls that are equal at all of them are equal at every one."""
SAME = 1e-9
"""[m] Distances that differ by rounding."""
FREE = 1e3
"""[m/s] A row that is not felt."""
SHARE = 0.9
"""Fraction of what the joints can do that recovery may ask for: the rest is for the task."""
ABOVE = 5e-5
"""Of w / w_max above the floor, and [m] above planes, where the tangents' barrier lies: sliding along it needs no step
shortened, and leaves a plan's passage room between its ticks."""
ROUNDING, TINY = 1e-12, 1e-12
PARTS = (0.0, 0.5, 1.0)
"""Of the way from the end of a tick to rest, where bounds are judged."""
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
    floor : least manipulability, as a fraction of `max_manipulability`.
    max_manipulability : largest manipulability of the arm.
    linear_speed : [m/s] of the tool's origin, its true norm.
    deviation : [m] largest distance of the tool's origin from the reference.
    planes : what to stay out of, with the chain's capsules, its tool's origin and the origins of its frames, as far as
        joints move them (`guarded_points`).
    rate : [1/s] at which the distance to a bound may decay.
    dt : tick [s].
    recovery_speed : fraction of the joints' speeds at which the arm is led back above the floor.
    limits : a user's own.
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
    clearance: ClearancePairs | None = None

    @property
    def count(self) -> int:
        """Number of rows."""
        return 2 + len(self.distances)

    @cached_property
    def distances(self) -> PostureLimits:
        """What the arm keeps to the planes, a user's own limits, and clearance."""
        planes = [Limit(partial(self._above, plane)) for plane in self.planes]
        own = [each if each.rate is not None else replace(each, rate=self.rate) for each in (*planes, *self.limits)]
        return PostureLimits(
            own, self.chain, self.dt, self.clearance, recovery_speed=self.recovery_speed, fastest_rate=self.rate
        )

    @property
    def _margins(self) -> list[float]:
        """[m] for every row of `distances` but those of bodies: none of a user's limits, whose units are not known."""
        planes = len(self.planes) * min(len(self.guarded), ROWS)
        own = sum(each.count(self.chain) for each in self.limits)
        return [ABOVE] * planes + [0.0] * own

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
    ) -> tuple[ca.SX, ca.SX, Now]:
        """R (m, n), r (m,), and how things are.

        Parameters
        ----------
        q, last : (n,) joint positions, and their velocity in the last tick.
        centre : (3,) [m] the reference.
        lead : (n,) stands for the gradient of w where that vanishes, else zero.
        loss : what the last tick lost of w / w_max against its tangent: counted on again.
        bounds : of the joint velocities.
        contacts : the nearest, see `PostureLimits.contacts`.
        """
        fraction = (1 - math.exp(-self.rate * self.dt)) / self.dt
        w, slope_of_w = self.manipulability(q)
        gradient = slope_of_w + lead
        ascent = fraction * (self.floor + ABOVE - w) + loss / self.dt
        frames = self.chain.frames_expression(q)
        pose = frames[-1]
        normals, most = [], []
        away = pose[:3, 3] - centre
        distance = ca.norm_2(away)
        unit = away / ca.fmax(distance, 1e-9)
        far = distance > 0.25 * self.deviation  # a row at the very centre has no direction
        normals.append(unit.T @ self.chain.jacobian_expression(q)[:3, :])
        most.append(ca.if_else(far, fraction * ca.fmax(self.deviation - distance, 0), FREE))
        slopes, falls = self.distances.falls(q, last, contacts, margins=ca.DM(self._margins), ticks=self.ways(last)[-1])
        normals.append(-slopes)
        most.append(falls)
        slow = ca.DM(self.recovery_speed * self.chain.velocity)
        calm = ca.dot(ca.fabs(gradient), slow)
        rows = feasible_rows(
            gradient, ascent, calm=calm, normals=ca.vertcat(*normals), most=ca.vertcat(*most), bounds=bounds,
            braking=self.braking(last), leading=len(self.distances),
        )  # fmt: skip
        return *rows, Now(w, slope_of_w, pose)

    def ways(self, velocity: ca.SX) -> list[ca.SX]:
        """Ticks of `velocity` (n,) to the ends of this one and of parts of the way to rest, all joints slowing alike.

        With N the ticks in which the slowest joint to stop stops, velocities fall by 1/N of `velocity` a tick: further
        ones lead as far as N - (N + 1)/2 of it. Braking stays on that line, and comes to rest where it ends.
        """
        ticks = ticks_to_rest(velocity, self.change)
        whole = ca.floor(ticks)
        further = whole - whole * (whole + 1) / (2 * ca.fmax(ticks, TINY))
        return [1 + further * part for part in PARTS]

    def braking(self, last: ca.SX) -> ca.SX:
        """(n,) the velocity after a tick of braking of all joints alike, as fast as their accelerations allow."""
        return slowed_together(last, self.change)

    @cached_property
    def change(self) -> ca.DM:
        """(n,) largest change of a velocity in a tick."""
        return max_change(self.chain, self.dt)

    def kept(
        self, q: ca.SX, velocity: ca.SX, centre: ca.SX, *, w: ca.SX, gradient: ca.SX, here: ca.SX, hand: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Whether a tick keeps every bound and may be followed by braking; whether it may brake; w / w_max then; loss.

        What is broken already must not get worse; a velocity that brakes has no distance from the reference to keep.
        `w`, `gradient` (n,), `here` (3,) and `hand` (3,) are w / w_max, its gradient and the tool's origin at q and its
        velocity. The loss is what w falls short of its tangent on the way to rest, of a tick's fraction of it.
        """
        ways = self.ways(velocity)
        ends = [q + self.dt * way * velocity for way in ways]
        fractions = [self.chain.manipulability_expression(end) / self.max_manipulability for end in ends]
        places = [self.chain.pose_expression(end)[:3, 3] for end in ends]
        fast = [ca.norm_2(each) for each in (hand, self.chain.jacobian_expression(ends[0])[:3, :] @ velocity)]
        reach = self.linear_speed * (1 + 1e-9) - self.dt**2 / 8 * tool_jerk(self.chain, q, velocity, self.dt)
        away = ca.fmax(ca.norm_2(here - centre), self.deviation) + ROUNDING
        lower, upper = ca.fmin(q, self.chain.lower) - ROUNDING, ca.fmax(q, self.chain.upper) + ROUNDING
        now = [fractions[0] >= ca.fmin(w, self.floor) - ROUNDING, *(each <= reach for each in fast)]
        later = [fraction >= ca.fmin(w, self.floor + ABOVE / 2) - ROUNDING for fraction in fractions[1:]]
        slower = self.braking(velocity)
        later.append(ca.norm_2(self.chain.jacobian_expression(ends[0] + self.dt * slower)[:3, :] @ slower) <= reach)
        later += [ends[-1] >= lower, ends[-1] <= upper, *(ca.norm_2(place - centre) <= away for place in places)]
        for conditions, some in ((now, slice(1)), (later, slice(1, None))):
            for plane in self.planes:
                before = self.heights(self.chain.frames_expression(q), plane)
                for end in ends[some]:
                    there = self.heights(self.chain.frames_expression(end), plane)
                    conditions += [b >= ca.fmin(a, 0) - ROUNDING for a, b in zip(before, there, strict=True)]
            if self.limits:
                own = PostureLimits(self.limits, self.chain, self.dt)
                conditions += [own.kept(q, way * velocity) for way in ways[some]]
        slope = ca.dot(gradient, velocity) * self.dt
        loss = ca.SX(0)
        for way, fraction in zip(ways, fractions, strict=True):
            loss = ca.fmax(loss, (w + way * slope - fraction) / way)
        braking = all_true(*now)
        return ca.logic_and(braking, all_true(*later)), braking, fractions[0], loss

    def min_heights(self, q: Array, plane: KeepOut) -> Array:
        """(M,) [m] of what is guarded above a plane at q (M, n); negative where the arm is in the keep-out."""
        symbol = ca.SX.sym("q", self.chain.n)
        heights = ca.vertcat(*self.heights(self.chain.frames_expression(symbol), plane))
        return np.array(ca.Function("height", [symbol], [ca.mmin(heights)])(q.T)).ravel()

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
    ascent: ca.SX,
    *,
    calm: ca.SX,
    normals: ca.SX,
    most: ca.SX,
    bounds: VelocityBounds,
    braking: ca.SX,
    leading: int = 0,
) -> tuple[ca.SX, ca.SX]:
    """Rows that some velocity within the intervals satisfies, always.

    The floor's row is gradient . q' >= ascent, a positive `ascent` being capped by `calm` and by what the joints can do
    in this tick. The others are `normals` q' <= `most`, of which the last `leading` may be negative. The feasible
    velocity is `braking` (n,), moved towards the fastest ascent as far as the floor's row requires, then across each
    negative row, orthogonally to `gradient`, and back as far as the other rows require. No row is tighter than this
    velocity allows; `HandBounds.kept` checks the rest.
    """
    lower, upper = bounds.lower, bounds.upper
    rest = clipped(braking, lower, upper)
    fastest = ca.if_else(gradient > 0, upper, lower)
    slope, max_ascent = ca.dot(gradient, rest), ca.dot(gradient, fastest)
    required = ca.if_else(ascent > 0, ca.fmin(ca.fmin(ascent, calm), SHARE * ca.fmax(max_ascent, 0)), ascent)
    part = clipped((required - slope) / ca.fmax(max_ascent - slope, TINY), 0, 1)
    feasible = rest + part * (fastest - rest)
    lead = range(most.numel() - leading, most.numel())
    pushes = [_past(normals[i, :].T, gradient) for i in lead]
    for i, push in list(zip(lead, pushes, strict=True)) * min(leading, PASSES):
        over = ca.if_else(most[i] < 0, ca.fmax(normals[i, :] @ feasible - most[i], 0), 0)
        feasible = clipped(feasible - over * push, lower, upper)
    slowest, speeds, fraction = normals @ rest, normals @ feasible, ca.SX(1)
    for i in range(most.numel()):
        max_here = ca.fmax(ca.fmax(most[i], 0) if i in lead else most[i], slowest[i])
        part = (max_here - slowest[i]) / ca.fmax(speeds[i] - slowest[i], TINY)
        fraction = ca.fmin(fraction, ca.if_else(speeds[i] > max_here, part, 1))
    feasible = rest + fraction * (feasible - rest)
    least = ca.fmin(required, ca.dot(gradient, feasible))
    return ca.vertcat(-gradient.T, normals), ca.vertcat(-least, ca.fmax(most, normals @ feasible))


def _past(normal: ca.SX, gradient: ca.SX) -> ca.SX:
    """(n,) that leads by 1 along `normal` and not along `gradient`; as far as they differ."""
    push = normal - gradient * (ca.dot(normal, gradient) / ca.fmax(ca.sumsqr(gradient), TINY))
    return push / ca.fmax(ca.dot(normal, push), TINY)


# ------------------------------------------- balls that stand for an arm before a plane: capsules, frames and the tool
class GuardedPoint(NamedTuple):
    """Ball that moves with a frame of a chain."""

    frame: int
    """As in `LinkCapsule`: joints 1 to `frame` move it."""
    offset: tuple[float, float, float]
    """(3,) [m] of its centre, in the frame."""
    radius: float
    """[m]"""


def guarded_points(chain: SerialChain) -> tuple[GuardedPoint, ...]:
    """Balls of which the whole arm is beside a plane where they are, the tool's first.

    A plane's distance to a capsule is the smaller one of those to the balls at its ends, exactly. Frame origins and
    the tool's are balls of no radius. Left out is a ball that no joint moves, and one that always lies in another.
    """
    origin = (0.0, 0.0, 0.0)
    balls = [GuardedPoint(frame, origin, 0.0) for frame in range(chain.n + 2)]
    balls += [GuardedPoint(each.frame, end, each.radius) for each in chain.capsules for end in (each.start, each.end)]
    balls.sort(key=lambda ball: (-ball.radius, ball.frame))  # of two that coincide, fewer joints move the first
    q = ca.SX.sym("q", chain.n)
    frames = chain.frames_expression(q)
    centres = ca.horzcat(*(frames[i][:3, :3] @ ca.DM(offset) + frames[i][:3, 3] for i, offset, _ in balls))
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (SAMPLES, chain.n))
    places = np.array([ca.Function("centres", [q], [centres])(each) for each in drawn]).transpose(2, 0, 1)
    kept: list[int] = []
    for i, ball in enumerate(balls):
        moves = np.ptp(places[i], axis=0).max() > SAME
        apart = np.linalg.norm(places[kept] - places[i], axis=2)  # (kept, samples)
        rides = np.ptp(apart, axis=1) <= SAME
        within = apart.max(axis=1) <= [balls[k].radius - ball.radius + SAME for k in kept]
        if moves and not np.any(rides & within):
            kept.append(i)
    return tuple(sorted((balls[i] for i in kept), key=lambda ball: -ball.frame))
