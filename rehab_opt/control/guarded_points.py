"""Balls that stand for an arm before a plane: the ends of its link capsules, its frames' origins and its tool."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["GuardedPoint", "guarded_points"]

SAMPLES = 5
"""Random postures at which balls are compared; what is equal at all of them is equal at every posture."""
SAME = 1e-9
"""[m] Distances that differ by rounding."""


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
