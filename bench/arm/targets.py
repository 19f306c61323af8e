"""Hand targets whose answer is known beforehand: reachable ones, unreachable ones, and paths inside the reachable set.

A target is the hand position of joint angles within limits whose handle is within 99.9 % of the tilt: reachable by
construction, and checked with the chain's own pose. Joint angles are drawn uniformly in the range of motion and moved
to the nearest ones that hold the handle (an ipopt projection), so the targets spread as the arm does, over all heights.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bench.arm.baselines import Baseline, nearest_point, position_ik, projection
from rehab_opt import SerialChain

__all__ = ["figure_eight", "handle_tilt", "holds", "random_path", "reachable", "unreachable"]

Array = NDArray[np.float64]

INSIDE = 0.999
"""Share of the tilt tolerance that targets use: on the very boundary, reachable would be a matter of rounding."""
HEIGHT = -0.24
"""[m] plane of the recordings and of the figure-eight (II-D, Rossa et al.)."""


def handle_tilt(arm: SerialChain, q: Array) -> float:
    """Angle of the handle to the vertical [rad], accurate at small angles too."""
    handle = arm.pose(q)[:3, 0]
    return math.atan2(math.hypot(handle[0], handle[1]), handle[2])


def holds(arm: SerialChain, q: Array, tilt: float) -> bool:
    """Whether q (n,) is within limits, exactly, and its handle within `tilt`."""
    return bool(np.all((q >= arm.lower) & (q <= arm.upper))) and handle_tilt(arm, q) <= tilt


def reachable(arm: SerialChain, count: int, *, tilt: float, seed: int = 0) -> Array:
    """(count, 3) hand positions."""
    random = np.random.default_rng(seed)
    hold = projection(arm, tilt=INSIDE * tilt)
    targets: list[Array] = []
    while len(targets) < count:
        q = _held(arm, hold, random.uniform(arm.lower, arm.upper), tilt)
        if q is not None:
            targets.append(arm.pose(q)[:3, 3])
    return np.array(targets)


def unreachable(
    arm: SerialChain, count: int, *, tilt: float, near: float = 0.01, far: float = 0.3, starts: int = 8, seed: int = 0
) -> Array:
    """(count, 3) points between `near` and `far` [m] outside the reachable set, as far as `starts` solves can tell.

    A reachable point is moved in a random direction by up to 0.6 m; most draws are inside or too far and fall out.
    """
    random = np.random.default_rng(seed)
    nearest = nearest_point(arm, tilt=tilt)
    pool = reachable(arm, max(count, 20), tilt=tilt, seed=seed + 1)
    targets: list[Array] = []
    while len(targets) < count:
        direction = random.normal(size=3)
        step = random.uniform(near, 0.6) * direction / np.linalg.norm(direction)
        point = pool[random.integers(len(pool))] + step
        distance = nearest_distance(arm, nearest, point, starts, random)
        if near <= distance <= far:
            targets.append(point)
    return np.array(targets)


def nearest_distance(
    arm: SerialChain, nearest: Baseline, point: Array, starts: int, random: np.random.Generator
) -> float:
    """Smallest distance [m] of the hand to `point` (3,) over local solves from random joint angles."""
    best = math.inf
    for _ in range(starts):
        answer = nearest(random.uniform(arm.lower, arm.upper), point)
        if answer.found:
            best = min(best, float(np.linalg.norm(arm.pose(np.clip(answer.q, arm.lower, arm.upper))[:3, 3] - point)))
    return best


def random_path(
    arm: SerialChain, samples: int, *, tilt: float, seed: int, dt: float = 0.01, fastest: float = 1.0
) -> Array:
    """(samples, 3) smooth random hand path: joints swing slowly within their range, the handle held on the way.

    A projection that changes branch would make the hand jump: a path faster than `fastest` [m/s] is drawn anew.
    """
    random = np.random.default_rng(seed)
    hold = projection(arm, tilt=INSIDE * tilt)
    time = dt * np.arange(samples)
    while True:
        phases, rates = random.uniform(0, 2 * math.pi, (2, arm.n)), random.uniform(0.3, 1.5, (2, arm.n))
        swing = np.sin(np.multiply.outer(time, rates) + phases).mean(axis=1)  # (samples, n) in -1..1
        wanted = (arm.lower + arm.upper) / 2 + swing * (arm.upper - arm.lower) / 2
        held = [_held(arm, hold, q, tilt) for q in wanted]
        if any(q is None for q in held):
            continue
        path = np.array([arm.pose(q)[:3, 3] for q in held if q is not None])
        if np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= fastest * dt:
            return path


def figure_eight(
    arm: SerialChain, samples: int, *, tilt: float, dt: float = 0.01, period: float = 4.0, cells: int = 15
) -> Array:
    """(samples, 3) figure-eight in the plane z = `HEIGHT`, as large as a circle that fits into the reachable slice.

    The slice is sampled: random joint angles projected onto plane and handle give its box, a grid of solves its shape.
    """
    random = np.random.default_rng(0)
    hold = projection(arm, tilt=INSIDE * tilt, height=HEIGHT)
    nearest, reach = nearest_point(arm, tilt=INSIDE * tilt), position_ik(arm, tilt=INSIDE * tilt, solver="ipopt")
    found = [hold(random.uniform(arm.lower, arm.upper), random.uniform(arm.lower, arm.upper)) for _ in range(100)]
    inside = np.array([arm.pose(answer.q)[:2, 3] for answer in found if answer.found])
    axes = [np.linspace(inside[:, i].min(), inside[:, i].max(), cells) for i in range(2)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    free = np.array(
        [nearest_distance(arm, nearest, np.append(point, HEIGHT), 2, random) <= 1e-4 for point in grid], dtype=bool
    )
    pitch = max(axis[1] - axis[0] for axis in axes)
    outside = [np.linalg.norm(grid[~free] - point, axis=1).min() if not free.all() else math.inf for point in grid]
    box = [min(np.min([point - inside.min(0), inside.max(0) - point]) + pitch / 2, 1.0) for point in grid]
    room = np.where(free, np.minimum(outside, box), 0.0)
    best = int(np.argmax(room))
    radius = 0.8 * max(room[best] - pitch / 2, pitch / 2)
    phase = 2 * math.pi * dt * np.arange(samples) / period
    shape = np.column_stack([np.sin(phase), np.sin(phase) * np.cos(phase)])
    while True:
        path = np.column_stack([grid[best] + radius * shape, np.full(samples, HEIGHT)])
        once = path[:: max(samples // 100, 1)]  # the grid is coarse: what it promises is checked
        if all(_reached(arm, reach, point, random) for point in once):
            return path
        radius *= 0.8


def _reached(arm: SerialChain, reach: Baseline, point: Array, random: np.random.Generator, starts: int = 5) -> bool:
    return any(reach(random.uniform(arm.lower, arm.upper), point).found for _ in range(starts))


def _held(arm: SerialChain, hold: Baseline, q: Array, tilt: float) -> Array | None:
    answer = hold(q, q)
    q = np.clip(answer.q, arm.lower, arm.upper)
    return q if answer.found and holds(arm, q, tilt) else None
