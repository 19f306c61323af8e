"""Many samples as few: those in one small cell become one at their centroid, and by how much that can change a force.

Let a group have its centroid a vector d away from x, its members within h of the centroid, and b = |d| h / sigma^2.
A member's weight differs from that of the centroid by exp(y), y = (d.delta - |delta|^2 / 2) / sigma^2. The deltas have
mean zero, so that by Jensen's and Hoeffding's inequalities the group's whole weight is wrong by a factor between
exp(-h^2 / 2 sigma^2) and exp(b^2 / 2) only: an error of second order. `merging_bound` carries these factors, and
what the members' own offsets can do within a group, through Eq. (20).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.samples import Samples

__all__ = ["Merged", "merged", "merging_bound"]

Array = NDArray[np.float64]

MOST = 1000
"""Samples that are evaluated in a tick without a second thought: about 25 us compiled."""
FINEST, COARSEST = 64, 8
"""Cells along one sigma: as many as `MOST` allows, and never fewer than the last."""


class Merged(NamedTuple):
    """Few samples that stand for many."""

    samples: Samples
    radius: Array
    """(K,) [m] distance of the furthest member from the centroid."""
    offset_spread: Array
    """(K,) [J] largest difference of a member's phi_0 from the mean."""
    stiffness_spread: Array
    """(K,) [N/m] largest difference of a member's stiffness from the mean."""
    cell: float
    """[m] side of the cells; 0 where nothing was merged."""


def merged(samples: Samples, width: float, most: int = MOST) -> Merged:
    """At most about `most` samples, merged in the smallest cells that give so few; unchanged where they are so few.

    They must not lean: samples are merged before any does.
    """
    count = len(samples.points)
    if count <= most:
        return Merged(samples, np.zeros(count), np.zeros(count), np.zeros(count), 0.0)
    division = FINEST
    group = _cells(samples.points, width / division)
    while group.max() >= most and division > COARSEST:
        division //= 2
        group = _cells(samples.points, width / division)
    weights = np.exp(samples.log_weights)
    total = np.bincount(group, weights)

    def mean(column: Array) -> Array:
        return np.bincount(group, weights * column) / total

    points = np.column_stack([mean(column) for column in samples.points.T])
    offsets = mean(samples.offsets)
    stiffness = np.column_stack([mean(column) for column in samples.stiffness.T])
    spreads = [np.zeros(len(total)) for _ in range(3)]
    for spread, difference in zip(
        spreads,
        (
            np.linalg.norm(samples.points - points[group], axis=1),
            np.abs(samples.offsets - offsets[group]),
            np.abs(samples.stiffness - stiffness[group]).max(axis=1),
        ),
        strict=True,
    ):
        np.maximum.at(spread, group, difference)
    few = Samples(points, offsets, stiffness, np.log(total), np.zeros_like(points))
    return Merged(few, *spreads, width / division)


def _cells(points: Array, side: float) -> NDArray[np.int64]:
    """(N,) number of the cell of each point, counted from 0."""
    cell = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
    group: NDArray[np.int64] = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)[1]
    return group.reshape(-1)


def merging_bound(merge: Merged, width: float, point: Array) -> float:
    """[N] by how much the force at `point` (2,) can differ from that of all samples, at most."""
    if not merge.cell:
        return 0.0
    points, offsets, stiffness, log_weights, _ = merge.samples
    h, stiff = merge.radius, stiffness.max(axis=1) + merge.stiffness_spread
    away = point - points
    size = np.linalg.norm(away, axis=1)
    exponents = log_weights - size**2 / (2 * width**2)
    q = np.exp(exponents - exponents.max())
    q /= q.sum()
    with np.errstate(over="ignore", invalid="ignore"):
        loss, b = h**2 / (2 * width**2), size * h / width**2
        gain = np.exp(b**2 / 2)
        most, least = gain / np.exp(-(loss.max())), np.exp(-loss) / (q @ gain)
        wrong = np.maximum(most - 1, 1 - least)  # |p - q| / q of a group's weight
        tilt = np.minimum(1.0, b + loss)  # a mean within a group moves by at most the spread times that of y
        moved = h * tilt
        spread = merge.offset_spread + stiff * (size * h + h**2 / 2) + merge.stiffness_spread * size**2 / 2
        shifted = tilt * spread + stiff * h**2 / 2 + merge.stiffness_spread * size * h
        energies = offsets + 0.5 * (stiffness * away**2).sum(axis=1)
        over, around = np.abs(energies - q @ energies), np.linalg.norm(away - q @ away, axis=1)
        p = q * (1 + wrong)
        mean_over = q @ (wrong * over) + p @ shifted
        mean_around = q @ (wrong * around) + p @ moved
        product = q @ (wrong * over * around) + p @ (over * moved + around * shifted + h * spread)
        pull = q @ (wrong * stiff * size) + p @ (stiff * moved + merge.stiffness_spread * (size * tilt + h))
        bound = float(pull + (product + mean_over * mean_around) / width**2)
    return bound if bound >= 0 else np.inf
