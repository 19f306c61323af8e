"""Default runs: seeded random runs with far targets, jumps, and hands that leave the workspace."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.hand_task import FRAMES
from rehab_opt.control.limit import PostureLimits
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.workspace.region import Workspace

__all__ = ["hand_run", "mirror_reference", "pair_run", "resolver_run", "tracker_run"]

Array = NDArray[np.float64]
Ticks = list[dict[str, Any]]

TICKS, EACH = 2000, 100
"""Number of ticks of a run, and of one target in it."""
WIDEST = np.pi
"""[rad, m] Range of joints without limits."""


def tracker_run(tracker: PoseTracker) -> Ticks:
    """Targets that jump within and beyond the arm's reach, some of them moving; joints move as commanded."""
    rng, chain, moving = np.random.default_rng(0), tracker.chain, tracker.limits.moving
    tracker.reset()
    q, ticks = best_posture(tracker, rng), Ticks()
    for k in range(TICKS):
        if k % EACH == 0:
            goal = chain.pose(q + rng.normal(size=chain.n) * rng.choice([1e-3, 0.1, 1.0]))
            twist = rng.normal(size=6) * rng.choice([0.0, 0.1, 3.0])
            bodies = bodies_about(goal[:3, 3], tracker.limits, rng) if moving else None
        tick = {"q": q.copy(), "pose": goal, "twist": twist, **({"obstacles": bodies} if moving else {})}
        ticks.append(tick)
        q = q + tracker.dt * tracker.step(**tick).value
    return ticks


def bodies_about(place: Array, limits: PostureLimits, rng: np.random.Generator) -> Array:
    """(k, 14) moving capsules around a point (3,) [m], some of them absent."""
    most = limits.moving
    bodies = np.zeros((most, limits.moving_size // most))
    for body in bodies[: rng.integers(most + 1)]:
        body[:6], body[6:12] = np.tile(place + 0.3 * rng.normal(size=3), 2), 0.1 * rng.normal(size=6)
        body[12:] = 0.05, 1.0
    return bodies


def mirror_reference(tracker: MirrorTracker) -> Ticks:
    """A hand that moves around its pose at the first q, at times faster than the arm; capsules move around the hand."""
    rng, limits = np.random.default_rng(0), tracker.limits
    q = best_posture(tracker, rng)
    t = tracker.dt * np.arange(TICKS)[:, None]
    rates, phases = rng.uniform(0.5, 4.0, 3), rng.uniform(0, 2 * np.pi, 3)
    poses, twists = np.tile(tracker.chain.pose(q), (TICKS, 1, 1)), np.zeros((TICKS, 6))
    poses[:, :3, 3] += 0.1 * (np.sin(rates * t + phases) - np.sin(phases))
    twists[:, :3] = 0.1 * rates * np.cos(rates * t + phases)
    ticks = [{"q": q, "pose": pose, "twist": twist} for pose, twist in zip(poses, twists, strict=True)]
    for k in range(0, TICKS if limits.moving else 0, EACH):
        bodies = bodies_about(poses[k, :3, 3], limits, rng)
        ticks[k : k + EACH] = [{**tick, "obstacles": bodies} for tick in ticks[k : k + EACH]]
    return ticks


def resolver_run(resolver: RedundancyResolver) -> Ticks:
    """Ticks with twists in every set of rows and both frames, up to twice the robot's speed; it moves as commanded."""
    rng, chain, most = np.random.default_rng(0), resolver.robot.chain, resolver.limits.moving
    widest = max(map(len, resolver.row_sets))
    resolver.reset()
    q, ticks = middle(chain.lower, chain.upper), Ticks()
    names = list(FRAMES)
    for k in range(TICKS):
        if k % EACH == 0:
            rows, frame = int(rng.integers(len(resolver.row_sets))), names[rng.integers(len(names))]
            twist = rng.normal(size=widest) * rng.choice([0.0, 0.1, 1.0])
            around = {"obstacles": bodies_about(chain.pose(q)[:3, 3], resolver.limits, rng)} if most else {}
        ticks.append({"q": q.copy(), "twist": twist, "rows": rows, "frame": int(FRAMES[frame]), **around})
        set_of_rows = resolver.row_sets[rows]
        command = resolver.step(q, twist[: len(set_of_rows)], set_of_rows, frame, moving=around.get("obstacles"))
        q = q + resolver.dt * command.value
    return ticks


def hand_run(region: Workspace, dt: float) -> Array:
    """(N, 2) [m] positions of a hand that circles inside and outside a workspace."""
    west, south, east, north = map(float, region.polygon.bounds)
    t = dt * np.arange(TICKS)
    round_and_round = np.column_stack([np.sin(2.0 * t), np.sin(5.0 * t + 1.0)])
    centre, size = np.array([west + east, south + north]) / 2, np.array([east - west, north - south])
    return np.asarray(centre + 0.6 * size * round_and_round)


def pair_run(pair: Bilateral) -> tuple[Array, Array, Sequence[Any], Sequence[Any]]:
    """Hand positions (N, 2) [m] of a helper and a participant who follows, and the messages that each side gets."""
    workspace_map = pair.helper.workspace_map
    hands = hand_run(workspace_map.source, pair.dt)
    drawn = np.array([workspace_map.image(hand) for hand in hands])
    drawn += 0.004 * np.sin(4 * np.pi * pair.dt * np.arange(TICKS))[:, None]
    pair.reset()
    received = []
    for hand, other in zip(hands, drawn, strict=True):
        received.append(pair.under_way)
        pair.step(hand, other)
    pair.reset()
    return hands, drawn, [each[0] for each in received], [each[1] for each in received]


def middle(lower: Array, upper: Array) -> Array:
    """(n,) middle of each joint's range; `WIDEST` replaces an infinite limit."""
    return np.asarray((np.maximum(lower, -WIDEST) + np.minimum(upper, WIDEST)) / 2)


def best_posture(controller: VelocityController, rng: np.random.Generator) -> Array:
    """(n,) among random postures, the one with the largest manipulability."""
    chain = controller.chain
    centre = middle(chain.lower, chain.upper)
    half = np.minimum((chain.upper - chain.lower) / 2, WIDEST)
    postures = centre + 0.8 * half * rng.uniform(-1.0, 1.0, (100, chain.n))
    return np.asarray(max(postures, key=chain.manipulability))
