"""Retiming of a plan by Ruckig: the same joint path, without the stops and hesitations of tick-by-tick planning.

Ruckig treats the reference's clock and the hand's path length as two more axes. A passage is one timed run along the
path. Its ticks are checked like commands; if one violates a bound, the passage is rejected.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Relaxed
from rehab_opt.control.mirror_statement import WHOLE
from rehab_opt.control.path_timing import PathCells, ruckig_timing
from rehab_opt.control.stopping import max_change
from rehab_opt.control.tool_speed import tool_jerk

if TYPE_CHECKING:
    from rehab_opt.control.mirror import MirrorTracker
    from rehab_opt.control.mirror_plan import MirrorPath

__all__ = ["retimed"]

Array = NDArray[np.float64]

APART, OFTEN = 4e-3, 0.02
"""Spacing of the points on the path: [rad or m] of the joint that moves furthest, or [s] of the reference."""
PARTS = 4
"""Number of cells of constant acceleration between two points."""
NEVER = 0.9
"""No passage takes less than this fraction of the shortest time for a stretch."""
PART = 1.0 - 1e-6
"""Used fraction of the speed and acceleration limits, so that rounding does not matter."""
SHARE = 0.998
"""Used fraction of the largest hand speed, since between two checked points the speed may be slightly larger."""
TRIES, SLOWER = 16, 0.7
"""Largest number of passages, and speed factor after a straight passage that violated a bound."""
CURVED, CLOSELY, STRAIGHT = range(3)
"""Kinds of path through the points: a smooth curve, a curve through every tick of the plan, or straight lines."""
ABOUT = 20, 3
"""Numbers of ticks to either side of a violated bound. Within the first number, the next passage replaces a smooth
curve by one through every tick of the plan; within the second, it replaces such a curve by straight lines.
"""
BROKEN, EXACT = 1e-9, 1e-12
"""Tolerances for a bound, and for a joint limit."""


def retimed(tracker: MirrorTracker, plan: MirrorPath, left: Array) -> MirrorPath:
    """The plan timed by Ruckig, or the plan itself if no passage satisfies every bound.

    left : (M,) [s] remaining time from the clock to the reference's end, at each tick of the plan.
    """
    way = np.abs(np.diff(plan.q, axis=0)).max(axis=1, initial=0.0)
    if not plan.complete or any(each & Relaxed.ACCELERATION for each in set(plan.relaxed)) or way.sum() < APART:
        return plan
    ways, slow = np.full(len(plan.times), CURVED), np.ones(len(plan.times))
    for _ in range(TRIES):
        passage = _passed(tracker, plan, left, ways, slow)
        if passage is None:
            return plan
        found, ticks = passage
        broken = _broken(tracker, found, plan)
        if not broken.any():
            return found
        around, at = np.zeros((len(ABOUT), len(ways)), dtype=bool)
        for tick in ticks[broken].tolist():
            for which, about in zip((around, at), ABOUT, strict=True):
                which[max(tick - about, 0) : tick + about] = True
        slow[at & (ways == STRAIGHT)] *= SLOWER
        ways[at & (ways == CLOSELY)] = STRAIGHT
        ways[around & (ways == CURVED)] = CLOSELY
    return plan


def _passed(
    tracker: MirrorTracker, plan: MirrorPath, left: Array, ways: NDArray[np.int_], slow: Array
) -> tuple[MirrorPath, NDArray[np.int_]] | None:
    """Time the path by Ruckig; return the new plan and, for each of its ticks, the tick of `plan`; None if slower.

    ways, slow : (M,) kind of path, and speed factor, at each tick of `plan`.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator  # noqa: PLC0415  (loaded when used)

    chain, dt, n = tracker.chain, tracker.dt, tracker.chain.n
    hand = np.linalg.norm(np.diff(plan.poses[:, :3, 3], axis=0), axis=1)
    # The position at a tick's end is paired with the tick's reference, since the distance between them is bounded.
    gone = np.append(-dt * plan.paces[0], left[0] - left[:-1])
    x = np.column_stack([plan.q, gone, np.append(0.0, np.cumsum(hand))])
    passed = _passed_points(x, ways > CURVED)
    at = _points(passed)
    speeds = PART * np.append(chain.velocity, [1.0, SHARE * tracker.linear_speed])
    seconds = (np.abs(np.diff(x[at], axis=0)) / speeds).max(axis=1)
    # The path parameter's speed is at most 1, so a slower stretch gets a longer interval of the parameter.
    least = np.where(slow[at] < 1.0, 1.0 / slow[at], NEVER)[1:]
    knots = np.append(0.0, np.cumsum(least * np.maximum(seconds, 1e-6)))
    slopes = CubicSpline(knots, x[at, :n], bc_type="clamped")(knots, 1)
    slopes[ways[at] >= STRAIGHT] = 0.0
    slopes[(x[at, :n] <= chain.lower + APART) | (x[at, :n] >= chain.upper - APART)] = 0.0
    # The clock never runs back.
    curves = CubicHermiteSpline(knots, x[at, :n], slopes), PchipInterpolator(knots, x[at, n:])
    edges = np.append((knots[:-1, None] + np.diff(knots)[:, None] * np.arange(PARTS) / PARTS).ravel(), knots[-1])
    first, second, third = (np.hstack([curve(edges, order) for curve in curves]) for order in (1, 2, 3))
    # The hand's speed varies between two points and is largest at an end of a tick with held velocities.
    hand = _hand_speeds(tracker, curves[0](edges) - 0.5 * dt * first[:, :n], first[:, :n])
    first[:-1, -1] = np.maximum(hand[:-1], hand[1:])
    second[:, -1] = third[:, -1] = 0.0
    cells = PathCells(edges, first[:-1], second[:-1], third[:-1])
    accelerations = PART * np.append(np.minimum(chain.acceleration, 2 * chain.velocity / dt), [np.inf, np.inf])
    timing = ruckig_timing(cells, velocity=speeds, acceleration=accelerations, fastest=1.0)
    if not timing.times[-1] <= dt * (len(plan.times) - 2):
        return None  # slower than the plan; a passage that nearly rests in between may take days
    place = timing.at(dt * np.arange(math.ceil(timing.times[-1] / dt) + 1))
    moved = np.hstack([curve(place) for curve in curves])
    moved[0], moved[-1] = x[0], x[-1]
    q = moved[:, :n]
    velocities = np.append(np.diff(q, axis=0), np.zeros((1, n)), axis=0) / dt
    end = left[0] - left[-1]
    references, clock = tracker.clock.left(left[0] - np.clip(np.append(moved[1:, n], end), 0.0, end))
    paces = np.diff(clock, prepend=plan.clock[0] - dt * plan.paces[0]) / dt
    # Where the plan rests, its last tick there counts: only then is the remaining deviation known.
    begins = np.interp(np.interp(place, knots, passed[at]), passed, np.arange(len(passed)))
    k = begins.astype(int)
    slowed = (paces < WHOLE) & (clock < clock[-1])
    said = {each: (each & ~Relaxed.TASK, each | Relaxed.TASK) for each in set(plan.relaxed)}
    bounds = [said[plan.relaxed[i]][late] for i, late in zip(k.tolist(), slowed.tolist(), strict=True)]
    symbol, w = ca.SX.sym("q", n), tracker.hand_bounds.manipulability
    share_of = ca.Function("w", [symbol], [w(symbol)[0]]).map(len(q))(np.vstack([q[1:], q[-1:]]).T)
    # The remaining deviation jumps, so take its largest value around each tick. Turns are checked where a tick
    # begins, distances where it ends.
    leads = np.maximum(np.append(begins[1:], begins[-1:]) - 1.0, 0.0)
    about = [np.floor(leads).astype(int), np.ceil(leads).astype(int), np.ceil(begins).astype(int)]
    short, person = (each[about].max(axis=0) for each in (plan.short, plan.person))
    found = plan._replace(
        times=np.asarray(dt * np.arange(len(q)), dtype=np.float64), q=q, velocities=velocities,
        poses=tracker.tools(list(q)), references=references, clock=clock, short=short, person=person, paces=paces,
        manipulability=np.array(share_of).ravel(), relaxed=bounds,
        counts=Counter(plan.counts | {"slowed": int(slowed.sum())}),
    )  # fmt: skip
    return found, k


def _hand_speeds(tracker: MirrorTracker, q: Array, velocities: Array) -> Array:
    """Largest tool speeds (M,) [m/s] in ticks from q (M, n) at `velocities` (M, n); angular speeds count, scaled."""
    chain, dt = tracker.chain, tracker.dt
    at, change = ca.SX.sym("q", chain.n), ca.SX.sym("change", chain.n)
    twists = [chain.jacobian_expression(at + part * dt * change) @ change for part in (0, 1)]
    linear = ca.fmax(*(ca.norm_2(twist[:3]) for twist in twists)) + dt**2 / 8 * tool_jerk(chain, at, change, dt)
    angular = ca.fmax(*(ca.norm_2(twist[3:]) for twist in twists))
    most = ca.fmax(linear, tracker.linear_speed / tracker.angular_speed * angular)
    fast = ca.Function("fast", [at, change], [most])
    return np.array(fast.map(len(q))(q.T, velocities.T)).ravel()


def _passed_points(x: Array, fine: NDArray[np.bool_]) -> Array:
    """Number of path points (M,), spaced by `APART` or `OFTEN`, that the plan has passed at each of its ticks.

    x : (M, n + 2) joint positions, clock and path length. fine : (M,) whether every tick of the plan is a point.
    """
    moved = np.maximum(np.abs(np.diff(x[:, :-2], axis=0)).max(axis=1) / APART, np.diff(x[:, -2]) / OFTEN)
    return np.append(0.0, np.cumsum(np.where(fine[1:] & (moved > 0.01), 1.0, moved)))


def _points(passed: Array) -> NDArray[np.int_]:
    """Ticks of the plan that become points of the path: the first, the last, and each at which a new point begins."""
    at = np.unique(np.searchsorted(passed, np.arange(math.ceil(passed[-1]))))
    last = int(np.searchsorted(passed, passed[-1]))
    return np.append(at[passed[at] < passed[last] - 0.5], last)


def _broken(tracker: MirrorTracker, found: MirrorPath, plan: MirrorPath) -> NDArray[np.bool_]:
    """Whether each tick (M,) violates a bound of the arm, or the largest deviation from the reference."""
    moving = np.zeros((tracker.limits.moving_size, len(found.q)))
    kept = np.array(tracker.limits.judged.map(len(found.q))(found.q.T, moving, found.velocities.T))[0] > 0.5
    kept &= _hand_speeds(tracker, found.q, found.velocities) <= tracker.linear_speed * (1 + BROKEN)
    ends = np.vstack([found.poses[1:], found.poses[-1:]])[:, :3, 3]
    apart = np.linalg.norm(ends - found.references[:, :3, 3], axis=1) - found.short[:, 0]
    kept[1:] &= apart[1:] <= np.maximum(apart[:-1], tracker.max_deviation) + BROKEN
    turned, before = found.turns - found.short[:, 1], plan.turns - plan.short[:, 1]
    kept &= turned <= max(tracker.max_turn, before.max()) + BROKEN
    chain, after = tracker.chain, found.q + tracker.dt * found.velocities
    within = np.minimum(found.q, chain.lower) - EXACT <= after, after <= np.maximum(found.q, chain.upper) + EXACT
    kept &= np.all(within, axis=(0, 2))
    change = np.abs(np.diff(found.velocities, axis=0, prepend=0.0))
    kept &= (change <= np.array(max_change(chain, tracker.dt)).ravel() * (1 + BROKEN)).all(axis=1)
    return np.asarray(~kept)
