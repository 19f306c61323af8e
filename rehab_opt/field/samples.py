"""Samples of a field's paths: evenly spaced points, and their distances along the path to its end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.plausible import ROOM
from rehab_opt.kinematics.real_array import checked_array

__all__ = [
    "HAND_SPEED",
    "SampledPath",
    "Samples",
    "arc_length",
    "checked_paths",
    "interpolated",
    "mean_path",
    "resampled_path",
    "strides",
]

Array = NDArray[np.float64]

MEAN_POINTS = 400
"""Number of points of a mean path."""
HAND_SPEED = 10.0
"""[m/s] Largest speed of a hand; a faster jump is a sensor error."""
MAX_MAGNITUDE = 1e2
"""[m] Largest coordinate of a path; a larger value means a wrong unit."""
MAX_SAMPLES = 1_000_000
"""Largest number of samples of a path; more come from a wrong unit and would exhaust the memory."""


class Samples(NamedTuple):
    """Samples of a field; Eqs. (15)-(17) are sums over these rows.

    Sample j, at x_j, has the energy phi_j = phi_0j + lean_j^T d + 1/2 d^T S_j d at d = x - x_j.
    """

    points: Array
    """(K, 2) [m]"""
    offsets: Array
    """(K,) phi_0 [J]"""
    stiffness: Array
    """(K, 2) diagonal of S [N/m]"""
    log_weights: Array
    """(K,) logarithm of the number of samples that this one represents."""
    lean: Array
    """(K, 2) [N] slope added to a sample's energy; zero for samples of a path."""

    @classmethod
    def of_path(cls, points: Array, offsets: Array, stiffness: Array) -> Samples:
        """One sample for each of points (m, 2)."""
        return cls(points, offsets, stiffness, np.zeros(len(points)), np.zeros_like(points))

    def joined(self, other: Samples) -> Samples:
        """Two sets of samples as one: these, then `other`."""
        return Samples(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def taken(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Samples:
        """The samples in these rows."""
        return Samples(*(column[rows] for column in self))


class SampledPath(NamedTuple):
    """One path as evenly spaced points, with the length from each point to the end."""

    points: Array
    """(m, 2) [m] first to last."""
    remaining: Array
    """(m,) [m] length along the path to its end: Eq. (22), Rossa et al."""
    travelled: Array
    """(m,) [m] length along the path from its start."""
    tangents: Array
    """(m, 2) unit direction of travel; zero for a path that is one point."""


def checked_paths(path: ArrayLike | Sequence[ArrayLike], argument: str = "path") -> tuple[Array, ...]:
    """One path (N, 2) or a sequence of them as float arrays.

    Raises
    ------
    ConfigurationError : no points, another shape, numbers that are not finite or not metres.
    """
    several = (isinstance(path, np.ndarray) and path.ndim == 3) or (
        isinstance(path, Sequence) and len(path) > 0 and _has_rows(path[0])
    )
    given: list[Any] = list(path) if several else [path]  # type: ignore[arg-type]
    paths = []
    for i, each in enumerate(given):
        name = argument if len(given) == 1 else f"{argument}[{i}]"
        points = np.array(checked_array(name, each, "points (N, 2) in metres"))
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise ConfigurationError(name, f"an array of shape {points.shape}", "points (N, 2) in metres")
        if not np.all(np.abs(points) <= ROOM):
            worst = points[~(np.abs(points) <= ROOM)][0]
            raise ConfigurationError(name, float(worst), f"finite coordinates within {ROOM:g} m (in millimetres?)")
        paths.append(points)
    return tuple(paths)


def _has_rows(path: ArrayLike) -> bool:
    try:
        return np.ndim(path) == 2
    except ValueError:  # rows of unequal lengths
        return False


def arc_length(points: Array) -> Array:
    """(N,) [m] length along `points` (N, 2) up to each point."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))


def resampled_path(points: Array, spacing: float, argument: str = "spacing") -> SampledPath:
    """Points at equal distances of at most `spacing` [m] along the path, both ends included.

    Even spacing makes the weighted mean of Eq. (17) independent of pauses of the hand.

    Raises
    ------
    ConfigurationError : more than `MAX_SAMPLES`; the error names `argument`, which set the spacing.
    """
    length = arc_length(points)
    whole = float(length[-1])
    if not whole <= MAX_SAMPLES * spacing:
        value = f"{spacing:.3g} m between the samples of a path of {whole:.3g} m"
        raise ConfigurationError(argument, value, f"{MAX_SAMPLES} samples at most (another unit?)")
    if whole == 0.0:
        zero = np.zeros(1)
        return SampledPath(points[:1].copy(), zero, zero.copy(), np.zeros((1, 2)))
    along = np.linspace(0.0, whole, int(np.ceil(whole / spacing)) + 1)
    even = interpolated(points, points, along)
    even[-1] = points[-1]
    slopes = np.gradient(even, along, axis=0)
    sizes = np.linalg.norm(slopes, axis=1, keepdims=True)
    tangents = np.divide(slopes, sizes, out=np.zeros_like(slopes), where=sizes > 0)
    return SampledPath(even, whole - along, along, tangents)


def interpolated(points: Array, values: Array, along: Array) -> Array:
    """Values at the lengths `along` (m,) [m] of a path, interpolated between `values` (N, k) at its points (N, 2)."""
    length = arc_length(points)
    moving = np.concatenate(([True], np.diff(length) > 0))
    return np.column_stack([np.interp(along, length[moving], column) for column in values[moving].T])


def strides(points: Array, step: float) -> Array:
    """Subset (m, 2) of `points` (N, 2) with neighbours more than `step` [m] apart; first and last points are kept."""
    kept, last = [0], points[0].tolist()
    for i, (x, y) in enumerate(points.tolist()):
        if math.hypot(x - last[0], y - last[1]) > step:
            kept.append(i)
            last = (x, y)
    if kept[-1] != len(points) - 1:
        kept.append(len(points) - 1)
    return points[kept]


def mean_path(paths: Sequence[Array], smoothing: float) -> Array:
    """(N, 2) mean of several paths at equal fractions of their lengths, smoothed over the length `smoothing` [m].

    The mean path begins at the mean of the starts and ends at the mean of the ends. Lengths are measured in steps of
    half of `smoothing`: otherwise sensor noise of a resting hand would add metres, and equal fractions of two paths
    would not correspond.
    """
    fractions = np.linspace(0.0, 1.0, MEAN_POINTS)
    paths = [strides(each, smoothing / 2) for each in paths]
    mean: Array = np.mean([interpolated(each, each, fractions * arc_length(each)[-1]) for each in paths], axis=0)
    for _ in range(2):  # smoothing shortens the path, so it is repeated with the new length
        length = arc_length(mean)[-1]
        reach = int(np.ceil(4 * smoothing / max(length, smoothing) * MEAN_POINTS))
        reach = min(reach, MEAN_POINTS - 1)
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * length / MEAN_POINTS / smoothing) ** 2)
        # The path is reflected through its ends, so that smoothing keeps them.
        before, after = 2 * mean[0] - mean[reach:0:-1], 2 * mean[-1] - mean[-2 : -2 - reach : -1]
        longer = np.concatenate((before, mean, after))
        mean = np.column_stack([np.convolve(column, kernel / kernel.sum(), "valid") for column in longer.T])
        mean = interpolated(mean, mean, fractions * arc_length(mean)[-1])
    return mean
