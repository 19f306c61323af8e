"""Points that a thin-plate spline sends to given ones: damped Newton on the map itself, from several starts.

The spline fitted the other way is no inverse, only a good start. A row is solved when its image is as near as
`tolerance_terms` say; then it is polished until rounding stops it, so that the error is that of evaluating the map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.spline_fit import SplineFit

__all__ = ["preimage", "preimages", "tolerance_terms"]

Array = NDArray[np.float64]
Starts = Callable[[Array], Array]
"""Wanted images (K, 2) -> initial guesses (K, 2)."""

ITERATIONS = 40
HALVINGS = 12
DECREASE = 1e-4
"""Share of the decrease that the linear model promises which a step must deliver."""
SHARE = 1e-13
EPSILON = float(np.finfo(np.float64).eps)


def tolerance_terms(fit: SplineFit) -> tuple[float, float]:
    """Distance [m] between a wanted image and one that rounding lets us tell from it, with a margin.

    Returns
    -------
    What it is at the origin [m], and by how much it grows with the wanted image's distance from there.
    """
    constant = SHARE * float(np.abs(fit.affine).sum()) + 16 * EPSILON * float(np.abs(fit.weights).sum())
    return constant, SHARE


def preimages(
    evaluate: Callable[[Array], tuple[Array, Array]], fit: SplineFit, images: Array, starts: list[Starts]
) -> Array:
    """(M, 2) points whose images are (M, 2); NaN rows where no start led to one.

    Parameters
    ----------
    evaluate : points (K, 2) -> images (K, 2) and Jacobians (K, 2, 2).
    starts : tried in turn, each on the rows that those before it left open.
    """
    found = np.full(images.shape, np.nan)
    constant, growth = tolerance_terms(fit)
    tolerance = constant + growth * np.hypot(images[:, 0], images[:, 1])
    open_rows = np.flatnonzero(np.isfinite(images).all(axis=1))
    for start in starts:
        if not open_rows.size:
            break
        points, distance = _newton(evaluate, images[open_rows], start(images[open_rows]), tolerance[open_rows])
        solved = distance <= tolerance[open_rows]
        found[open_rows[solved]] = points[solved]
        open_rows = open_rows[~solved]
    return found


def _newton(
    evaluate: Callable[[Array], tuple[Array, Array]], images: Array, start: Array, tolerance: Array
) -> tuple[Array, Array]:
    """Points (K, 2) and how far their images (K,) remain from the wanted ones; NaN distances where a start is NaN."""
    points = np.array(start)
    values, slopes = evaluate(points)
    off = values - images
    distance = np.hypot(off[:, 0], off[:, 1])
    moving = np.flatnonzero(np.isfinite(distance))
    for _ in range(ITERATIONS):
        if not moving.size:
            break
        steps = _newton_steps(slopes[moving], off[moving])
        length, trying = np.ones(len(moving)), np.arange(len(moving))
        improved = np.zeros(len(moving), dtype=bool)
        for _ in range(HALVINGS):
            rows = moving[trying]
            candidates = points[rows] - length[trying, np.newaxis] * steps[trying]
            values, new_slopes = evaluate(candidates)
            new_off = values - images[rows]
            new_distance = np.hypot(new_off[:, 0], new_off[:, 1])
            better = new_distance <= (1 - DECREASE * length[trying]) * distance[rows]
            better &= new_distance < distance[rows]
            taken = rows[better]
            points[taken], slopes[taken] = candidates[better], new_slopes[better]
            off[taken], distance[taken] = new_off[better], new_distance[better]
            improved[trying[better]] = True
            # A solved row whose full step does not help is as good as rounding allows.
            trying = trying[~better & (distance[rows] > tolerance[rows])]
            if not trying.size:
                break
            length[trying] /= 2
        moving = moving[improved & (distance[moving] > 0)]
    return points, distance


def _newton_steps(slopes: Array, off: Array) -> Array:
    (a, b), (c, d) = np.moveaxis(slopes, 0, -1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = 1 / (a * d - b * c)
        return np.column_stack(((d * off[:, 0] - b * off[:, 1]) * scale, (a * off[:, 1] - c * off[:, 0]) * scale))


def preimage(
    evaluate: Callable[[float, float], tuple[float, ...]],
    x_wanted: float,
    y_wanted: float,
    starts: Iterable[tuple[float, float]],
    tolerance: float,
) -> tuple[float, float]:
    """One point as `preimages` finds it, in plain floats, since arrays of two numbers cost more than the map.

    Parameters
    ----------
    evaluate : x, y -> g_x, g_y, dg_x/dx, dg_x/dy, dg_y/dx, dg_y/dy.
    """
    for start in starts:
        x, y = start
        gx, gy, a, b, c, d = evaluate(x, y)
        u, v = gx - x_wanted, gy - y_wanted
        distance = math.hypot(u, v)
        for _ in range(ITERATIONS):
            determinant = a * d - b * c
            if not (determinant != 0 and 0 < distance < math.inf):
                break
            step_x, step_y = (d * u - b * v) / determinant, (a * v - c * u) / determinant
            length, improved = 1.0, False
            for _ in range(HALVINGS):
                new_x, new_y = x - length * step_x, y - length * step_y
                gx, gy, *slopes = evaluate(new_x, new_y)
                new_distance = math.hypot(gx - x_wanted, gy - y_wanted)
                improved = new_distance <= (1 - DECREASE * length) * distance and new_distance < distance
                if improved or distance <= tolerance:
                    break
                length /= 2
            if not improved:
                break
            x, y, (a, b, c, d) = new_x, new_y, slopes
            u, v, distance = gx - x_wanted, gy - y_wanted, new_distance
        if distance <= tolerance:
            return x, y
    return math.nan, math.nan
