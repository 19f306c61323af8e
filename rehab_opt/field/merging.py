"""Merge the samples in each small cell into one at their centroid.

Let d be the vector from a centroid to x, and delta the offset of a sample from the centroid. At x the sample has the
centroid's weight times exp((d.delta - |delta|^2 / 2) / sigma^2). The offsets of a group have mean zero, so the error of
its total weight is of second order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.samples import Samples

__all__ = ["merged"]

Array = NDArray[np.float64]

MOST = 1000
"""Largest number of samples that are not merged; they take about 25 us in compiled code."""
FINEST, COARSEST = 64, 8
"""Largest and smallest number of cells per sigma. The largest one that gives at most `MOST` samples is
used, else the smallest."""


def merged(samples: Samples, width: float, most: int = MOST) -> Samples:
    """Merge samples into at most `most`, or more if even the coarsest cells leave more.

    The cells are the smallest ones that suffice. The `lean` of the samples must be zero.
    """
    if len(samples.points) <= most:
        return samples
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
    stiffness = np.column_stack([mean(column) for column in samples.stiffness.T])
    return Samples(points, mean(samples.offsets), stiffness, np.log(total), np.zeros_like(points))


def _cells(points: Array, side: float) -> NDArray[np.int64]:
    cell = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
    group: NDArray[np.int64] = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)[1]
    return group.reshape(-1)
