"""Random hand paths through singular regions of the UR5, and its manipulability by the closed form."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt import SerialChain

Array = NDArray[np.float64]
LARGEST = 0.11987995741622055
"""Of the closed form, by Nelder-Mead over its two angles."""


def closed_form(q: Array) -> float:
    """W of the UR5 over its maximum: |a2 a3 s3 s5 (a2 c2 + a3 c23 + d5 s234)|."""
    a2, a3, d5 = -0.425, -0.39225, 0.09465
    reach = a2 * math.cos(q[1]) + a3 * math.cos(q[1] + q[2]) + d5 * math.sin(q[1] + q[2] + q[3])
    return abs(a2 * a3 * math.sin(q[2]) * math.sin(q[4]) * reach) / LARGEST


def singular_postures(rng: np.random.Generator) -> Array:
    """A UR5 posture with w = 0: elbow, wrist or shoulder singular, sometimes two of them."""
    q = rng.uniform(-1, 1, 6) * [2.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]
    kind = rng.integers(4)
    if kind in (0, 3):
        q[2] = 0.0
    if kind in (1, 3):
        q[4] = 0.0
    if kind == 2:  # the wrist centre above the first axis
        best = min(np.linspace(-2.8, -0.2, 400), key=lambda x: closed_form(np.array([0, x, q[2], q[3], 1.57, 0])))
        q[1] = best
    return q


def start_above(rng: np.random.Generator, fraction: float) -> Array:
    """A posture with w at least `fraction` of the maximum."""
    while True:
        q = rng.uniform(-1, 1, 6) * [2.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]
        if closed_form(q) >= fraction:
            return q


def random_path(
    chain: SerialChain, rng: np.random.Generator, dt: float, *, below: bool = False
) -> tuple[Array, Array, Array]:
    """Start (6,), poses (N, 4, 4) and twists (N, 6) of a motion from a good posture through a singular one and back."""
    start = singular_postures(rng) + 0.02 * rng.standard_normal(6) if below else start_above(rng, 0.35)
    middle = singular_postures(rng)
    middle = start + (middle - start) * min(1.0, 1.2 / float(np.abs(middle - start).max()) * rng.uniform(0.5, 2.0))
    end = start + 0.5 * rng.standard_normal(6)
    seconds = rng.uniform(1.0, 4.0)
    knots = [start, middle, end, start]
    q = []
    for a, b in itertools.pairwise(knots):
        u = np.linspace(0, 1, max(round(seconds / 3 / dt), 3), endpoint=False)[:, None]
        q.append(a + (b - a) * u**3 * (10 - 15 * u + 6 * u**2))
    joints = np.concatenate(q)
    speeds = np.gradient(joints, dt, axis=0)
    poses = np.array([chain.pose(each) for each in joints])
    twists = np.array([chain.jacobian(each) @ speed for each, speed in zip(joints, speeds, strict=True)])
    return start, poses, twists
