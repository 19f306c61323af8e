"""Joint limits, manipulability floor, keep-out plane and hand speed of the true robot."""

from __future__ import annotations

import numpy as np

from bench.physics.arms import Arm
from bench.physics.following import follow
from bench.physics.geometry import heights, manipulabilities
from bench.physics.setting import Array, Numbers, Setting
from rehab_opt import KeepOut, MirrorTracker, PoseTracker

__all__ = ["hand_bounds", "held_limit"]

APPROACH, HELD, PRESSED = 5.0, 3.0, 1.0
"""[s] Seven joints that go round by other limits took 3.3 s until the last of them had come to its own."""
AT_LIMIT = 1e-3
"""[rad] A joint that its limit holds was within 0.2 mrad of it; none that something else holds nearer than 8 mrad."""
PRESS = 30.0
"""[N] on the hand, any way, at last."""
FLOOR, PLANE, SPEED = 0.3, 0.2, 0.25
"""Share of the largest manipulability; [m] from the hand at the ready posture to the plane; [m/s]"""
CLEAR = 0.05
"""Above the floor, where a run begins."""


def held_limit(setting: Setting) -> Numbers:
    """A target beyond one joint's limit: approached as fast as the bounds allow, held for three seconds, then pressed.

    A servo that is pressed gives way: what counts is by how much more than one that is commanded to stand still there.
    """
    rng, arm = setting.rng, setting.arm
    chain = arm.chain
    start, joint, sign = arm.start(rng), int(rng.integers(chain.n)), float(rng.choice([-1.0, 1.0]))
    beyond = arm.start(rng)
    limit = (chain.upper if sign > 0 else chain.lower)[joint]
    beyond[joint] = limit + sign * rng.uniform(0.1, 0.4)
    target, still = chain.pose(beyond), np.zeros(6)
    tracker = setting.controller(PoseTracker, chain)
    push = rng.normal(size=3)
    push *= PRESS / np.linalg.norm(push)
    ticks, held, pressed = (round(each * setting.cell.rate) for each in (APPROACH + HELD, HELD, PRESSED))
    run = follow(
        setting.plant(), chain, start, ticks + pressed, lambda _, seen: tracker.step(seen.position, target, still),
        each=lambda k, _: push if k >= ticks else None,
    )  # fmt: skip
    beyond_any = np.maximum(run.q - chain.upper, chain.lower - run.q)
    bare, stays = setting.plant(), beyond_any[ticks - 1].max()
    bare.reset(run.q[ticks - 1])
    for _ in range(pressed):
        bare.step(np.zeros(chain.n), push)
        stays = max(
            stays, float(np.maximum(bare.truth.position - chain.upper, chain.lower - bare.truth.position).max())
        )
    run, over = run.until(ticks), beyond_any[:ticks]
    there = run.q[-held:]
    at_limit = np.abs(over[-held:].max(axis=0)) < AT_LIMIT
    swings = np.ptp(there, axis=0)
    return {
        "beyond the limit": float(over.max()),
        "beyond a bare servo": float(beyond_any[ticks:].max() - max(stays, 0.0)) if at_limit.any() else 0.0,
        # Where no joint came to its limit, there is nothing to hold.
        "limit: peak to peak": float(swings[at_limit].max()) if at_limit.any() else 0.0,
        "limit: hand RMS": float(np.sqrt(np.mean(run.hand_speed(slice(-held, None)) ** 2))) if at_limit.any() else 0.0,
        "limit reached": float(at_limit.any()),
    }


def hand_bounds(setting: Setting) -> Numbers:
    """A reference through the plane, out of reach and faster than the hand may be."""
    rng, arm = setting.rng, setting.arm
    chain, ready = arm.chain, arm.chain.pose(arm.ready)
    outward = ready[:3, 3] * [1.0, 1.0, 0.0] / np.hypot(*ready[:2, 3])
    plane = KeepOut.through(ready[:3, 3] + PLANE * outward, -outward)
    tracker = setting.controller(
        MirrorTracker, chain, floor=FLOOR, linear_speed=SPEED, keep_out=(plane,), max_deviation=0.1
    )
    start = _clear(tracker, plane, arm, rng)
    first = chain.pose(start)
    way = rng.normal(size=3) + outward
    way *= rng.uniform(0.4, 0.9) / np.linalg.norm(way)
    seconds = rng.uniform(1.5, 3.0)
    poses, twists = _there_and_back(first, way, seconds, setting.dt)
    run = follow(
        setting.plant(),
        chain,
        start,
        len(poses),
        lambda k, seen: tracker.step(seen.position, poses[k], twists[k]),
    )
    w = manipulabilities(chain, run.q) / tracker.max_manipulability
    return {
        "below the floor": FLOOR - float(w.min()),
        "into keep-out": -float(heights(chain, run.q, plane).min()),
        "hand speed": float(run.hand_speed().max()) / SPEED,
    }


def _clear(tracker: MirrorTracker, plane: KeepOut, arm: Arm, rng: np.random.Generator) -> Array:
    """(n,) [rad] from where every bound can be kept."""
    for _ in range(100):
        q = arm.start(rng, 0.15)
        above = manipulabilities(arm.chain, q[None])[0] / tracker.max_manipulability > FLOOR + CLEAR
        if above and heights(arm.chain, q[None], plane)[0] > 0.0:
            return q
    raise RuntimeError(f"{arm.name}: no posture near the ready one is above the floor and clear of the plane")


def _there_and_back(first: Array, way: Array, seconds: float, dt: float) -> tuple[Array, Array]:
    """Poses (N, 4, 4) and twists (N, 6) of a minimum-jerk motion by `way` (3,) [m], a stay, and the way back."""
    u = np.arange(round(seconds / dt)) * dt / seconds
    rise, rate = 10 * u**3 - 15 * u**4 + 6 * u**5, (30 * u**2 - 60 * u**3 + 30 * u**4) / seconds
    stay = np.ones(len(u) // 2)
    gone = np.concatenate([rise, stay, rise[::-1]])
    speed = np.concatenate([rate, 0 * stay, -rate[::-1]])
    poses = np.tile(first, (len(gone), 1, 1))
    poses[:, :3, 3] += gone[:, None] * way
    twists = np.zeros((len(gone), 6))
    twists[:, :3] = speed[:, None] * way
    return poses, twists
