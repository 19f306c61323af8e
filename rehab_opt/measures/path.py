"""Where a hand goes: how far, how straight, how near the target, and how much room it uses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.samples import rows, vectors

__all__ = ["end_error", "path_length", "path_ratio", "range_used", "workspace_used"]

Array = NDArray[np.float64]

FLAT = 1e-9
"""Points whose smallest extent is less than this fraction of their largest lie in a line or plane."""


def path_length(points: ArrayLike) -> float:
    """Length [m] of the path through points (N, d) [m]: sum |p_i+1 - p_i|."""
    return float(np.linalg.norm(np.diff(vectors("points", points), axis=0), axis=1).sum())


def path_ratio(points: ArrayLike, reference: ArrayLike | None = None) -> float:
    """Length of the path over that of the reference (M, d) [m], or over the straight line from its start to its end.

    Index of curvature: Cirstea and Levin, "Compensatory strategies for reaching in stroke", Brain 123(5), 2000. No
    unit: 1 is a straight line, pi/2 a half circle. NaN where the path ends just where it began, or the reference has no
    length: of a movement that comes back only a reference makes sense.
    """
    p = vectors("points", points, fewest=2)
    meant = float(np.linalg.norm(p[-1] - p[0])) if reference is None else path_length(reference)
    return path_length(p) / meant if meant > 0 else math.nan


def end_error(points: ArrayLike, target: ArrayLike) -> float:
    """Distance [m] of the last of points (N, d) [m] from the target (d,) [m].

    Accuracy: Schwarz et al., Stroke 50(3), 2019.
    """
    p, goal = vectors("points", points), vectors("target", np.atleast_2d(np.asarray(target, dtype=np.float64)))
    if goal.shape != (1, p.shape[1]):
        raise ConfigurationError("target", f"shape {goal.shape[1:]}", f"({p.shape[1]},), as the points")
    return float(np.linalg.norm(p[-1] - goal[0]))


def range_used(values: ArrayLike) -> Array:
    """(d,) largest minus smallest of values (N, d), or (N,): extents of points [m], ranges of joints [rad].

    The range used, not the range possible.
    """
    return np.asarray(np.ptp(rows("values", values), axis=0))


def workspace_used(points: ArrayLike) -> float:
    """Area [m^2] of the convex hull of points (N, 2) [m], or volume [m^3] of that of points (N, 3).

    The area that a hand encloses: Sukal, Ellis, Dewald, "Shoulder abduction-induced reductions in reaching work area
    following hemiparetic stroke", Exp. Brain Res. 183(2), 2007 (who trace it; here it is the hull of what was visited).
    Zero for points in a line, or in a plane of space.
    """
    p = vectors("points", points, fewest=2)
    if p.shape[1] not in (2, 3):
        raise ConfigurationError("points", f"shape {p.shape}", "(N, 2) or (N, 3)")
    extents = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if len(extents) < p.shape[1] or not extents[-1] > FLAT * extents[0]:
        return 0.0
    from scipy.spatial import ConvexHull  # noqa: PLC0415

    return float(ConvexHull(p).volume)  # of points in a plane Qhull's "volume" is the area
