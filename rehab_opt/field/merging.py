"""Many samples as few: those in one small cell become one at their centroid, and by how much that can change a force.

Let a group have its centroid a vector d away from x, its members r (root mean square) and at most h away from it. A
member's weight differs from that of the centroid by exp(y), y = (d.delta - |delta|^2 / 2) / sigma^2. The deltas have
mean zero, so that the whole weight of the group is wrong by a factor between exp(-r^2 / 2 sigma^2) (Jensen) and
exp((|d| r / sigma^2)^2 exp(b) / 2), b = |d| h / sigma^2: an error of second order. Within a group, a mean of f under
such weights differs from the plain one by the integral of covariances of f and y, at most exp(2 max|y|) times the
product of their plain deviations: of second order, too. `merging_bound` carries both through Eq. (20).
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
    deviation: Array
    """(K,) [m] root mean square of those distances."""
    offset_deviation: Array
    """(K,) [J] standard deviation of the members' phi_0."""
    stiffness_deviation: Array
    """(K,) [N/m] of their stiffness, of the axis where it is largest."""
    stiffest: Array
    """(K,) [N/m] largest stiffness of a member."""
    cell: float
    """[m] side of the cells; 0 where nothing was merged."""


def merged(samples: Samples, width: float, most: int = MOST) -> Merged:
    """At most about `most` samples, merged in the smallest cells that give so few; unchanged where they are so few.

    They must not lean: samples are merged before any does.
    """
    count = len(samples.points)
    if count <= most:
        zero = np.zeros(count)
        return Merged(samples, zero, zero, zero, zero, samples.stiffness.max(axis=1), 0.0)
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
    square = ((samples.points - points[group]) ** 2).sum(axis=1)
    farthest, stiffest = np.zeros(len(total)), np.zeros(len(total))
    np.maximum.at(farthest, group, square)
    np.maximum.at(stiffest, group, samples.stiffness.max(axis=1))
    return Merged(
        Samples(points, offsets, stiffness, np.log(total), np.zeros_like(points)),
        radius=np.sqrt(farthest),
        deviation=np.sqrt(mean(square)),
        offset_deviation=np.sqrt(mean((samples.offsets - offsets[group]) ** 2)),
        stiffness_deviation=np.sqrt(np.max([mean(c**2) for c in (samples.stiffness - stiffness[group]).T], axis=0)),
        stiffest=stiffest,
        cell=width / division,
    )


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
    h, r, o, s, stiff = merge[1:6]
    away = point - points
    size = np.linalg.norm(away, axis=1)
    exponents = log_weights - size**2 / (2 * width**2)
    q = np.exp(exponents - exponents.max())
    q /= q.sum()
    with np.errstate(over="ignore", invalid="ignore"):
        b, loss = size * h / width**2, r**2 / (2 * width**2)
        gain = np.exp((size * r / width**2) ** 2 * np.exp(b) / 2)
        wrong = np.maximum(gain * np.exp(loss.max()) - 1, 1 - np.exp(-loss) / (q @ gain))  # |p - q| / q of a group
        p = q * (1 + wrong)
        favour = np.exp(2 * (b + h**2 / (2 * width**2)))  # at most, of one member's weight over another's
        tilt = favour * r * (size + h / 2) / width**2  # times a deviation: what a mean within the group moves by
        moved = tilt * r
        shifted = tilt * (o + s * size**2 / 2 + stiff * size * r) + favour * (size * s * r + stiff * r**2 / 2)
        together = favour * r * (o + s * size**2 / 2 + stiff * size * r + stiff * h * r / 2)
        energies = offsets + 0.5 * (stiffness * away**2).sum(axis=1)
        over, around = np.abs(energies - q @ energies), np.linalg.norm(away - q @ away, axis=1)
        mean_over, mean_around = q @ (wrong * over) + p @ shifted, q @ (wrong * around) + p @ moved
        product = q @ (wrong * over * around) + p @ (over * moved + around * shifted + together)
        pull = q @ (wrong * stiff * size) + p @ (stiff * moved + s * (size * tilt + favour * r))
        bound = float(pull + (product + mean_over * mean_around) / width**2)
    return bound if bound >= 0 else np.inf
