"""Areas of slices by brute force: Table I multiplied out, damped least squares from many starts to each node of a grid.

Nothing of `rehab_opt` is used, so that the library's slices can be held against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["reached_nodes", "slice_area"]

Array = NDArray[np.float64]
L0, L1, L2, L3 = 0.130, 0.290, 0.300, 0.070  # [m], II-D
A = (L0, 0.0, 0.0, L1, L2, 0.0, 0.0, 0.0)
ALPHA = np.deg2rad([0.0, -90.0, -90.0, 0.0, 0.0, 90.0, -90.0, 0.0])
D = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, L3)
REACHED = np.array([1e-4, 1e-4, 1e-4, 1e-5])  # [m], and of the cosine of the tilt: 0.02 deg at 2 deg
STEPS, LARGEST_STEP, DAMPING = 25, 0.4, 1e-7


def hand(q: Array) -> tuple[Array, Array, Array]:
    """Hand (k, 3) [m], handle's axis (k, 3), and their Jacobian (k, 6, 8), of postures (k, 8) [rad]: Eqs. (1), (2)."""
    frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    axes, origins = [], []
    for i in range(8):
        axes.append(frame[:, :3, 2])
        origins.append(frame[:, :3, 3])
        c, s, ca, sa = np.cos(q[:, i]), np.sin(q[:, i]), np.cos(ALPHA[i]), np.sin(ALPHA[i])
        zero, one = np.zeros(len(q)), np.ones(len(q))
        rows = [c, -s * ca, s * sa, A[i] * c, s, c * ca, -c * sa, A[i] * s, zero, sa * one, ca * one, D[i] * one]
        step = np.stack([*rows, zero, zero, zero, one], axis=1).reshape(-1, 4, 4)
        frame = frame @ step
    place, handle = frame[:, :3, 3], frame[:, :3, 0]
    moved = [np.cross(z, place - o) for z, o in zip(axes, origins, strict=True)]
    turned = [np.cross(z, handle) for z in axes]
    return place, handle, np.concatenate([np.stack(moved, axis=2), np.stack(turned, axis=2)], axis=1)


def reached_nodes(
    limits_deg: Sequence[Sequence[float]],
    nodes: Array,
    *,
    height: float,
    tilt_deg: float | None,
    starts: int,
    seed: int,
) -> NDArray[np.bool_]:
    """(k,) which points (k, 2) [m] of the plane a posture within limits (8, 2) reaches, the handle within its tilt."""
    random, found = np.random.default_rng(seed), np.zeros(len(nodes), dtype=bool)
    lower, upper = np.deg2rad(np.array(limits_deg, dtype=float)).T
    cosine = -2.0 if tilt_deg is None else float(np.cos(np.deg2rad(tilt_deg)))
    for _ in range(starts):
        left = np.flatnonzero(~found)
        target = np.column_stack([nodes[left], np.full(len(left), height)])
        q = random.uniform(lower, upper, (len(left), 8))
        for _ in range(STEPS):
            place, handle, jacobian = hand(q)
            short = np.maximum(cosine - handle[:, 2], 0.0)
            error = np.column_stack([target - place, short])
            here = (np.abs(error) < REACHED).all(axis=1)
            if here.any():
                found[left[here]] = True
                left, q, target, error, short, jacobian = (
                    each[~here] for each in (left, q, target, error, short, jacobian)
                )
            slopes = np.concatenate([jacobian[:, :3], (jacobian[:, 5] * (short > 0)[:, None])[:, None]], axis=1)
            wish = np.einsum("kij,ki->kj", slopes, error)
            held = ((q <= lower) & (wish <= 0)) | ((q >= upper) & (wish >= 0))
            slopes = slopes * ~held[:, None]
            gram: Any = slopes @ slopes.transpose(0, 2, 1) + DAMPING * np.eye(4)
            step = np.einsum("kij,ki->kj", slopes, np.linalg.solve(gram, error[:, :, None])[:, :, 0])
            step *= np.minimum(1.0, LARGEST_STEP / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
            q = np.clip(q + step, lower, upper)
    return found


def slice_area(
    limits_deg: Sequence[Sequence[float]],
    box: tuple[float, float, float, float],
    *,
    pitch: float,
    height: float = -0.24,
    tilt_deg: float | None = 2.0,
    starts: int = 12,
    seed: int = 0,
) -> float:
    """[m^2] the reached nodes of a grid over a box (x and y from, x and y to) [m], each a square of `pitch` [m].

    Raises
    ------
    AssertionError : the box cuts the slice off.
    """
    x, y = np.arange(box[0], box[2], pitch), np.arange(box[1], box[3], pitch)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    found = reached_nodes(
        limits_deg, nodes.reshape(-1, 2), height=height, tilt_deg=tilt_deg, starts=starts, seed=seed
    ).reshape(nodes.shape[:2])
    assert not np.concatenate([found[0], found[-1], found[:, 0], found[:, -1]]).any(), "the box cuts the slice off"
    return float(found.sum()) * pitch**2
