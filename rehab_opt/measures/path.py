"""Measures of a hand's path: length, straightness, end error, range and workspace used, variability."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.samples import numbers, rows, vectors

__all__ = [
    "end_error", "end_variability", "path_length", "path_ratio", "path_variability", "range_used", "workspace_used",
]  # fmt: skip

Array = NDArray[np.float64]

FLAT = 1e-9
"""Points lie in a line or plane if their smallest extent is below this fraction of their largest."""
INSTANTS = 101
"""Number of instants from 0 to 100 % of a movement."""


def path_length(points: ArrayLike) -> float:
    """Length [m] of the path through points (N, d) [m]: sum |p_i+1 - p_i|."""
    return float(np.linalg.norm(np.diff(vectors("points", points), axis=0), axis=1).sum())


def path_ratio(points: ArrayLike, reference: ArrayLike | None = None) -> float:
    """Path length over the length of a reference (M, d) [m], by default the straight line from start to end.

    Index of curvature: Cirstea and Levin, "Compensatory strategies for reaching in stroke", Brain 123(5), 2000. No
    unit: 1 is a straight line, pi/2 a half circle. NaN if the path ends where it begins or the reference has no length:
    a movement that returns to its start needs a reference.
    """
    p = vectors("points", points, fewest=2)
    meant = float(np.linalg.norm(p[-1] - p[0])) if reference is None else path_length(reference)
    return path_length(p) / meant if meant > 0 else math.nan


def end_error(points: ArrayLike, target: ArrayLike) -> float:
    """Distance [m] between the last of the points (N, d) [m] and the target (d,) [m].

    Accuracy: Schwarz et al., Stroke 50(3), 2019.
    """
    p, goal = vectors("points", points), numbers("target", target)
    if goal.shape != (p.shape[1],):
        raise ConfigurationError("target", f"shape {goal.shape}", f"({p.shape[1]},), as the points")
    return float(np.linalg.norm(p[-1] - goal))


def range_used(values: ArrayLike) -> Array:
    """(d,) largest minus smallest value in each column of values (N, d) or (N,): an extent [m] or a joint range [rad].

    This is the range used, not the range possible.
    """
    return np.asarray(np.ptp(rows("values", values), axis=0))


def workspace_used(points: ArrayLike) -> float:
    """Area [m^2] of the convex hull of points (N, 2) [m], or its volume [m^3] for points (N, 3) [m].

    Zero for points on a line, or for (N, 3) points in a plane. Sukal, Ellis, Dewald, "Shoulder abduction-induced
    reductions in reaching work area following hemiparetic stroke", Exp. Brain Res. 183(2), 2007, measure the area that
    the hand encloses; here it is the convex hull of the visited points.
    """
    p = vectors("points", points, fewest=2)
    if p.shape[1] not in (2, 3):
        raise ConfigurationError("points", f"shape {p.shape}", "(N, 2) or (N, 3)")
    extents = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if len(extents) < p.shape[1] or not extents[-1] > FLAT * extents[0]:
        return 0.0
    from scipy.spatial import ConvexHull  # noqa: PLC0415

    return float(ConvexHull(p).volume)  # for points in a plane Qhull's "volume" is the area


def path_variability(trials: Sequence[ArrayLike]) -> float:
    """Root mean square distance [m] between trials and their mean path, at equal fractions of their durations.

    Let p_k(u) be the point of trial k, of K trials, at the fraction u of its own duration. The result is

        sqrt( mean over u of  sum_k |p_k(u) - mean(u)|^2 / (K - 1) )

    Trials that differ only in speed have no variability: Darling and Cooke, "Changes in the variability of movement
    trajectories with practice", J. Mot. Behav. 19(3), 1987. Remove rest before and after the movement first.

    Parameters
    ----------
    trials : K >= 2 arrays (N_k, d) [m], evenly sampled, each of any length N_k >= 2.
    """
    fractions = np.linspace(0.0, 1.0, INSTANTS)
    at = [
        np.column_stack([np.interp(fractions, np.linspace(0.0, 1.0, len(path)), column) for column in path.T])
        for path in _trials(trials)
    ]
    return float(np.sqrt(_spread(np.stack(at)).mean()))


def end_variability(trials: Sequence[ArrayLike]) -> float:
    """Root mean square distance [m] of the trials' last points from their mean: sqrt(sum_k |e_k - mean|^2 / (K - 1)).

    This is the variable error; `end_error` of the mean last point is the constant error. Parameters and errors as in
    `path_variability`.
    """
    ends = np.stack([path[-1] for path in _trials(trials)])
    return float(np.sqrt(_spread(ends[:, None])[0]))


def _spread(at: Array) -> Array:
    """(T,) [m^2] variance among the K trials (K, T, d) at each instant, summed over the coordinates."""
    return np.asarray(at.var(axis=0, ddof=1).sum(axis=1))


def _trials(trials: Sequence[ArrayLike]) -> list[Array]:
    paths = [vectors(f"trials[{i}]", trial, fewest=2) for i, trial in enumerate(trials)]
    if len(paths) < 2:
        raise ConfigurationError("trials", f"{len(paths)} trials", "two or more")
    for i, path in enumerate(paths):
        if path.shape[1] != paths[0].shape[1]:
            expected = f"{paths[0].shape[1]} coordinates, as the first"
            raise ConfigurationError(f"trials[{i}]", f"{path.shape[1]} coordinates", expected)
    return paths
