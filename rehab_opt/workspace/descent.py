"""Limited-memory quasi-Newton descent for costs that are infinite where they are not defined."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["descent"]

Array = NDArray[np.float64]
MEMORY = 12
HALVINGS = 30
# Steps between looks at what must be kept, and at whether the descent still pays.
BETWEEN_LOOKS = 5


def descent(
    cost: Callable[[Array], tuple[float, Array]],
    start: Array,
    curvature: Array,
    *,
    steps: int,
    enough: float,
    keeps: Callable[[Array], bool] | None = None,
) -> tuple[Array, bool]:
    """A point of lower cost, and whether `keeps` stopped the descent.

    L-BFGS (Nocedal and Wright, Numerical Optimization, Algorithm 7.4) with backtracking: scipy's line search
    interpolates and so cannot meet an infinite cost; halving the step can.

    Parameters
    ----------
    cost : value (inf where undefined) and slope, for Y shaped as start.
    start : (n, k), of finite cost.
    curvature : (n, n) rough second derivative, the same for each column; the first metric.
    steps : most steps.
    enough : stop when `BETWEEN_LOOKS` steps together win less than this share of the cost.
    keeps : a property that the start has and the answer must have (looked at every few steps; the last point that has
        it is returned). None, or a start without it: nothing is looked at.
    """
    from scipy.linalg import cho_factor, cho_solve  # noqa: PLC0415  (slow to import)

    n = len(start)
    factor = cho_factor(curvature + 1e-9 * np.trace(curvature) / n * np.eye(n))
    looks = keeps if keeps is not None and keeps(start) else None
    Y, moves, bends = start, [], []  # type: tuple[Array, list[Array], list[Array]]
    value, slope = cost(Y)
    kept, looked = Y, value
    for step in range(1, steps + 1):
        direction = -_solved(slope, moves, bends, lambda b: np.asarray(cho_solve(factor, b)))
        downhill = float((direction * slope).sum())
        if not downhill < 0.0:
            break
        size = 1.0
        for _ in range(HALVINGS):
            Z = Y + size * direction
            new, new_slope = cost(Z)
            if new <= value + 1e-4 * size * downhill:
                break
            size *= 0.5
        else:
            break
        move, bend = Z - Y, new_slope - slope
        if (move * bend).sum() > 1e-10 * np.linalg.norm(move) * np.linalg.norm(bend):
            moves, bends = [*moves, move][-MEMORY:], [*bends, bend][-MEMORY:]
        Y, value, slope = Z, new, new_slope
        if step % BETWEEN_LOOKS == 0:
            if looks is not None and not looks(Y):
                return kept, True
            done = looked - value < enough * abs(value)
            kept, looked = Y, value
            if done:
                break
    lost = looks is not None and not looks(Y)
    return (kept if lost else Y), lost


def _solved(slope: Array, moves: list[Array], bends: list[Array], metric: Callable[[Array], Array]) -> Array:
    """The inverse of the approximate second derivative times the slope: the two-loop recursion."""
    q, fractions = slope.copy(), []
    for move, bend in zip(reversed(moves), reversed(bends), strict=True):
        fraction = (move * q).sum() / (move * bend).sum()
        fractions.append(fraction)
        q -= fraction * bend
    r = metric(q)
    if moves:
        r *= (moves[-1] * bends[-1]).sum() / (bends[-1] * metric(bends[-1])).sum()
    for move, bend, fraction in zip(moves, bends, reversed(fractions), strict=True):
        r += move * (fraction - (bend * r).sum() / (move * bend).sum())
    return r
