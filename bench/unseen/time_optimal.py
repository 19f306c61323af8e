"""The least time in which a joint path can be passed, by toppra (extra `peers`): the yardstick of a plan's duration."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

__all__ = ["least_seconds", "reference_seconds"]

Array = NDArray[np.float64]

APART = 4e-3
"""[rad] Way of the joint that moves furthest, from one point that the path's spline goes through to the next."""
FREE = 1e6
JUMP, SPIN = 5.0, 30.0
"""[m/s, rad/s] Faster than a hand: what `MirrorTracker` bridges, at `BRIDGE` of the hand's speeds."""
BRIDGE = 0.5


def reference_seconds(clock: Array, poses: Array, start: Array, dt: float, *, speed: float, turning: float) -> Array:
    """[s] that a reference needs at its own pace until its clock (M,) [s] stands where it does, bridges included.

    Its poses (N, 4, 4), dt apart from 0 on, begin with a bridge from `start` (4, 4), in the tick before; `speed` and
    `turning` [m/s, rad/s] are the hand's largest.
    """
    seen = np.flatnonzero(np.isfinite(poses[:, 0, 3]))
    times, way = np.append(-dt, dt * seen), np.concatenate([start[None], poses[seen]])
    far = np.linalg.norm(np.diff(way[:, :3, 3], axis=0), axis=1)
    turned = np.arccos(np.clip((np.einsum("nij,nij->n", way[1:, :3, :3], way[:-1, :3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    seconds = np.diff(times)
    jumps = (far > JUMP * seconds + 1e-3) | (turned > SPIN * seconds + 1e-2)
    jumps[0] = True
    bridges = np.maximum(far / (BRIDGE * speed), turned / (BRIDGE * turning))
    needed = np.where(jumps, np.maximum(seconds, bridges), seconds)
    return np.interp(clock, times, np.append(0.0, np.cumsum(needed)))


def least_seconds(
    q: Array, clock: Array, hand: Array, *, speed: Array, acceleration: Array, hand_speed: float
) -> float:
    """[s] along joint positions q (M, n), no faster than the recording, the hand no faster than it may be.

    The reference's `clock` (M,) [s], bridges included, is one more axis, with the speed 1; the way of the `hand` (M, 3)
    [m] another one.
    """
    import toppra  # noqa: PLC0415  (an optional extra)
    import toppra.algorithm  # noqa: PLC0415
    import toppra.constraint  # noqa: PLC0415

    logging.getLogger("toppra").setLevel(logging.ERROR)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(hand, axis=0), axis=1)))
    x = np.column_stack([q, clock, way])
    passed = np.append(0.0, np.cumsum(np.maximum(np.abs(np.diff(q, axis=0)).max(axis=1), 0.01 * np.diff(clock))))
    at = np.unique(np.searchsorted(passed, np.append(np.arange(0.0, passed[-1] - APART / 2, APART), passed[-1])))
    knots, x = passed[at], x[at]
    speeds, accelerations = np.append(speed, [1.0, hand_speed]), np.append(acceleration, [FREE, FREE])
    kind = toppra.constraint.DiscretizationType.Interpolation
    bounds = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-speeds, speeds])),
        toppra.constraint.JointAccelerationConstraint(
            np.column_stack([-accelerations, accelerations]), discretization_scheme=kind
        ),
    ]
    path = toppra.SplineInterpolator(knots, x, bc_type="natural")
    grid = np.linspace(0.0, knots[-1], max(2 * len(knots), 200))
    solver = toppra.algorithm.TOPPRA(bounds, path, gridpoints=grid, solver_wrapper="seidel")
    solver.compute_parameterization(0.0, 0.0)
    speeds = solver.problem_data.sd_vec
    return float("nan") if speeds is None else float(np.sum(2 * np.diff(grid) / (speeds[1:] + speeds[:-1])))
