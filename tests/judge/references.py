"""References as people and programs give them: held, moving on, sines, reaches with tremor, stops, jumps, ways back.

All are poses (N, 4, 4) of the UR5's flange and how they move (N, 6), `dt` apart.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from tests.judge.ur5_numbers import READY, hand_twist, manipulability, tool

Array = NDArray[np.float64]
KINDS = ("held", "moving on", "sines", "person", "sudden", "singular")


def minimum_jerk(ticks: int) -> Array:
    """(ticks,) from 0 to 1, at rest at both ends."""
    u = np.linspace(0.0, 1.0, max(ticks, 2))
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def reaches(rng: np.random.Generator, start: Array, ticks: int, dt: float, *, size: float) -> Array:
    """(ticks, m) reaches from place to place by minimum jerk, with pauses between them."""
    path, here = [start[None]], start
    count = 1
    while count < ticks:
        there = start + size * rng.uniform(-1.0, 1.0, len(start))
        moving = max(round(rng.uniform(0.3, 2.5) / dt), 2)
        resting = round(rng.choice([0.0, 0.0, 0.3, 1.5]) / dt)
        path.append(here + (there - here) * minimum_jerk(moving)[:, None])
        path.append(np.repeat(there[None], resting, axis=0))
        here, count = there, count + moving + resting
    return np.concatenate(path)[:ticks]


def tremor(rng: np.random.Generator, ticks: int, dt: float, *, size: float, axes: int) -> Array:
    """(ticks, axes) of 4 to 8 Hz."""
    time = dt * np.arange(ticks)[:, None]
    phases = rng.uniform(0, 2 * math.pi, axes)
    found = size * rng.uniform(0, 1, axes) * np.sin(2 * math.pi * rng.uniform(4, 8, axes) * time + phases)
    return np.asarray(found - found[0])


def sudden(rng: np.random.Generator, path: Array, dt: float) -> tuple[Array, Array]:
    """A path that stops at once, jumps, and goes back the way it came; and its true rate of change."""
    ticks, at, pace, left = len(path), 0.0, 1.0, 0
    places = np.empty(ticks)
    for k in range(ticks):
        if left == 0:
            pace, left = float(rng.choice([1.0, 1.0, 0.0, -1.0])), max(round(rng.uniform(0.1, 1.5) / dt), 1)
            if rng.random() < 0.2:
                at += rng.uniform(-1.0, 1.0) / dt
        at, left = min(max(at + pace, 0.0), ticks - 1.0), left - 1
        places[k] = at
    index = places.astype(int)
    rate = np.gradient(path, dt, axis=0)[index]
    return path[index], rate * np.diff(places, prepend=places[0]).clip(-1, 1)[:, None]


def singular_posture(rng: np.random.Generator, kind: int | None = None) -> Array:
    """w = 0: elbow stretched, wrist straight, wrist centre above the first axis, or two of them."""
    q = rng.uniform(-1, 1, 6) * [2.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]
    kind = int(rng.integers(4)) if kind is None else kind  # 3 is stretched and straight: w has no gradient there
    if kind in (0, 3):
        q[2] = 0.0
    if kind in (1, 3):
        q[4] = 0.0
    if kind == 2:
        shoulders = np.repeat(q[None], 400, axis=0)
        shoulders[:, 1], shoulders[:, 4] = np.linspace(-2.8, -0.2, 400), 1.57
        q = shoulders[int(np.argmin(manipulability(shoulders)))]
    return q


def good_posture(rng: np.random.Generator, fraction: float) -> Array:
    """A posture with at least that share of the largest w."""
    for _ in range(200):
        q = rng.uniform(-1, 1, 6) * [2.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]
        if manipulability(q[None])[0] >= fraction:
            return q
    return READY.copy()


def reference(rng: np.random.Generator, kind: str, start: Array, ticks: int, dt: float) -> tuple[Array, Array]:
    """Poses and twists of one kind of motion that begins at or near the joints `start` (6,)."""
    if kind == "held":
        q = start + rng.choice([0.05, 0.5, 1.5]) * rng.uniform(-1, 1, 6)
        pose = tool(q[None])
        pose[0, :3, 3] *= rng.choice([1.0, 1.0, 2.0])  # the last is out of reach
        return np.repeat(pose, ticks, axis=0), np.zeros((ticks, 6))
    if kind in ("moving on", "sines"):
        return _cartesian(rng, kind, start, ticks, dt)
    if kind == "singular":
        middle, seconds = singular_posture(rng), rng.uniform(0.5, 3.0)
        middle = start + (middle - start) * min(1.0, 1.2 / float(np.abs(middle - start).max()) * rng.uniform(0.5, 2.0))
        knots = [start, middle, start + 0.5 * rng.standard_normal(6), start]
        part = minimum_jerk(round(seconds / dt))[:, None]
        joints = np.concatenate([a + (b - a) * part for a, b in itertools.pairwise(knots)])
        joints = np.concatenate([joints, np.repeat(start[None], max(ticks - len(joints), 0), axis=0)])[:ticks]
    else:
        joints = reaches(rng, start, ticks, dt, size=float(rng.choice([0.1, 0.4, 0.8])))
        joints = joints + tremor(rng, ticks, dt, size=float(rng.choice([0.0, 2e-3])), axes=6)
    if kind == "sudden":
        joints, speed = sudden(rng, joints, dt)
    else:
        speed = np.gradient(joints, dt, axis=0)
    return tool(joints), hand_twist(joints, speed)


def _cartesian(rng: np.random.Generator, kind: str, start: Array, ticks: int, dt: float) -> tuple[Array, Array]:
    """A hand that moves on for ever, or to and fro, and turns about one axis."""
    time = dt * np.arange(ticks)
    way, axis = rng.standard_normal((2, 3))
    axis /= np.linalg.norm(axis)
    if kind == "moving on":
        way *= rng.uniform(0.02, 0.4) / np.linalg.norm(way)
        spin = rng.choice([0.0, 0.3, 1.0])
        place, velocity = np.outer(time, way), np.repeat(way[None], ticks, axis=0)
        angle, rate = spin * time, np.full(ticks, spin)
    else:
        size, speed = rng.uniform(0.02, 0.25, 3), 2 * math.pi * rng.uniform(0.03, 0.3, 3)
        place, velocity = size * np.sin(np.outer(time, speed)), size * speed * np.cos(np.outer(time, speed))
        swing, pace = rng.uniform(0.0, 0.6), 2 * math.pi * rng.uniform(0.03, 0.3)
        angle, rate = swing * np.sin(pace * time), swing * pace * np.cos(pace * time)
    first = tool(start[None])[0]
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle)[:, None, None] * cross + (1 - np.cos(angle))[:, None, None] * (cross @ cross)
    poses = np.repeat(first[None], ticks, axis=0)
    poses[:, :3, :3] = turn @ first[:3, :3]
    poses[:, :3, 3] += place
    return poses, np.concatenate([velocity, rate[:, None] * axis], axis=1)
