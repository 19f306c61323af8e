"""What a trial along a path was worth, from its arrays alone. Nothing here comes from the library."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Seen", "Verdict", "judged"]

Array = NDArray[np.float64]

PIECE = 5e-4
"""[m] of the path."""
RATE = 100.0
"""[Hz] at which a trial is looked at."""
WITHIN = 5e-3
"""[m] A place of the path nearer than this to the hand may count as covered."""
WINDOW, HELD, LEAD = 2.0, 10.0, 3.0
"""[s], [N], widths: a hand is stuck where for so long the force is no smaller, the progress less than a width, and the
intended place so far ahead."""


class Seen(NamedTuple):
    """One trial: place of the hand and force on it, tick by tick, and where the person meant to be."""

    position: Array
    """(N, 2) [m]"""
    force: Array
    """(N, 2) [N]"""
    intended: Array
    """(N, 2) [m]"""
    dt: float


class Verdict(NamedTuple):
    """Of one trial."""

    covered: float
    """Share of the path that the hand came by in order."""
    deviation: float
    """[m] root mean square from the arc in progress."""
    stuck: float
    """[s] of windows in which a hand was held that meant to go on."""


def judged(trial: Seen, path: Array, *, width: float) -> Verdict:
    """The verdict on a trial along a path (M, 2) [m], of a help of this width [m]."""
    step = max(1, round(1.0 / (RATE * trial.dt)))
    hands, force = trial.position[::step], np.linalg.norm(trial.force, axis=1)
    arcs, places = _even(path)
    square = ((hands[:, None, :] - places[None, :, :]) ** 2).sum(axis=2)
    covered = _covered(square <= WITHIN**2, reach=max(1, round(2 * width / arcs[1])))
    due = _due(square)
    away = np.sqrt(square[np.arange(len(hands)), due])
    stuck = _stuck(arcs[due], float(arcs[-1]), force[::step], trial, width=width, step=step)
    return Verdict(covered, float(np.sqrt(np.mean(away**2))), stuck)


def _even(path: Array) -> tuple[Array, Array]:
    length = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T))]
    arcs = np.linspace(0.0, length[-1], max(2, round(length[-1] / PIECE) + 1))
    return arcs, np.column_stack([np.interp(arcs, length, axis) for axis in path.T])


def _covered(near: NDArray[np.bool_], *, reach: int) -> float:
    """Of all ways in order through the places that are near, tick after tick, the most that one counts."""
    count = near.shape[1]
    number = np.arange(count, dtype=np.float64)
    best = np.where(number == 0, 0.0, -np.inf)
    for row in near:
        while row.any():
            ahead = np.r_[np.full(reach, -np.inf), best - number]
            linked = np.lib.stride_tricks.sliding_window_view(ahead, reach)[:count].max(axis=1) + number
            jumped = np.r_[-np.inf, np.maximum.accumulate(best)[:-1]]
            better = np.where(row, np.maximum(np.maximum(linked, jumped), best), best)
            if (better == best).all():
                break
            best = better
    return float(best.max() / (count - 1))


def _due(square: Array) -> NDArray[np.int64]:
    """(N,) the places in order that are nearest to the hand in the least squares: dynamic time warping."""
    ticks, count = square.shape
    total, before = np.where(np.arange(count) == 0, 0.0, np.inf), np.zeros((ticks, count), dtype=np.int32)
    for k in range(ticks):
        least = np.minimum.accumulate(total)
        new = np.r_[True, least[1:] < least[:-1]]
        before[k] = np.maximum.accumulate(np.where(new, np.arange(count), 0))
        total = least + square[k]
    due, at = np.zeros(ticks, dtype=np.int64), int(np.argmin(total))
    for k in reversed(range(ticks)):
        due[k], at = at, int(before[k, at])
    return due


def _stuck(arc: Array, last: float, force: Array, trial: Seen, *, width: float, step: int) -> float:
    """[s] of windows, each told by its begin."""
    meant = np.r_[0.0, np.cumsum(np.hypot(*np.diff(trial.intended, axis=0).T))][::step][: len(arc)]
    size = round(WINDOW / (trial.dt * step))
    if len(arc) <= size:
        return 0.0
    view = np.lib.stride_tricks.sliding_window_view
    held = view(force, size + 1).min(axis=1) >= HELD
    slow = arc[size:] - arc[:-size] < width
    ahead = view(meant - arc, size + 1).min(axis=1) > LEAD * width
    unfinished = arc[size:] < last - width
    return float((held & slow & ahead & unfinished).sum() * trial.dt * step)
