"""Eqs. (15)-(20) for many points at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.samples import Samples

__all__ = ["Influence", "energies_and_forces", "influences", "stiffness_at"]

Array = NDArray[np.float64]

AT_ONCE = 2_000_000
"""Largest number of point-sample pairs in memory."""


class Influence(NamedTuple):
    """Weights of all samples (K) at some points (N, 2)."""

    rows: slice
    """Rows of these points among all points."""
    weights: Array
    """(N, K) normalised weights, Eq. (16)."""
    away: Array
    """(N, K, 2) [m] from sample to point."""


def influences(samples: Samples, width: float, points: Array) -> Iterator[Influence]:
    """Weights of all samples at `points` (N, 2), in chunks of points."""
    step = max(1, AT_ONCE // len(samples.points))
    for start in range(0, len(points), step):
        rows = slice(start, min(start + step, len(points)))
        away = points[rows, None, :] - samples.points[None, :, :]
        exponents = samples.log_weights - (away**2).sum(axis=2) / (2 * width**2)
        weights = np.exp(exponents - exponents.max(axis=1, keepdims=True))
        yield Influence(rows, weights / weights.sum(axis=1, keepdims=True), away)


def energies_and_forces(samples: Samples, width: float, points: Array) -> tuple[Array, Array]:
    """(N,) Phi [J] and (N, 2) -grad Phi [N] at `points` (N, 2)."""
    energies, forces = np.empty(len(points)), np.empty((len(points), 2))
    for rows, weights, away in influences(samples, width, points):
        each = samples.energies(away)
        energies[rows] = mean = (weights * each).sum(axis=1)
        slope = weights * (each - mean[:, None]) / width**2
        forces[rows] = np.einsum("nk,nki->ni", slope, away) - np.einsum(
            "nk,nki->ni", weights, samples.lean + samples.stiffness * away
        )
    return energies, forces


def stiffness_at(samples: Samples, width: float, point: Array) -> Array:
    """(2, 2) [N/m] second derivative of Phi at `point` (2,)."""
    (_, weights, away), *_ = influences(samples, width, point[None])
    w, d = weights[0], away[0]
    pull = samples.lean + samples.stiffness * d
    each = samples.energies(d)
    around = d - w @ d
    over = each - w @ each
    # Twice the product rule on sum w phi / sum w; the derivative of w_j is -w_j (d_j - mean d) / sigma^2.
    mixed = np.einsum("k,ki,kj->ij", w, around, pull) / width**2
    spread = np.einsum("k,ki,kj->ij", w * over, around, around) / width**4
    stiffness: Array = np.diag(w @ samples.stiffness) - mixed - mixed.T + spread
    return stiffness
