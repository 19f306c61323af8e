"""Handwriting made by the sigma-lognormal model, with loops, cusps, crossings, stretches gone twice, and stops.

A stroke i moves the pen by an arc of the length D_i, of which the speed is lognormal in time:

    |v_i|(t) = D_i / (sigma_i sqrt(2 pi) (t - t_i)) exp(-(ln(t - t_i) - mu_i)^2 / (2 sigma_i^2)),

and the direction turns evenly along the arc, from a_i to b_i. Strokes overlap in time and add up as vectors (Plamondon
and Djioua 2006; O'Reilly and Plamondon 2009). Nothing here comes from the library that is judged.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

__all__ = ["KINDS", "Stroke", "handwriting", "pen_path"]

Array = NDArray[np.float64]

RATE = 200.0
"""[Hz] of the samples of a pen."""
KINDS = ("write", "loop", "cusp", "cross", "double", "stop")


class Stroke(NamedTuple):
    """One stroke: start [s], mu, sigma of the lognormal, length, direction at its begin and at its end [rad]."""

    start: float
    mu: float
    sigma: float
    length: float
    begin: float
    end: float


def pen_path(strokes: list[Stroke], seconds: float) -> Array:
    """(N, 2) where the pen is, `RATE` times a second, of strokes that add up; from rest in the origin."""
    time = np.arange(0.0, seconds, 1.0 / RATE)[:, None]
    of = np.array(strokes)
    start, mu, sigma, length, begin, end = of.T
    since = np.maximum(time - start, 1e-9)
    done = ndtr((np.log(since) - mu) / sigma)  # share of the arc's length
    turn = np.where(np.abs(end - begin) < 1e-6, 1e-6, end - begin)
    angle = begin + turn * done
    x = (length / turn * (np.sin(angle) - np.sin(begin))).sum(axis=1)
    y = (length / turn * (np.cos(begin) - np.cos(angle))).sum(axis=1)
    return np.column_stack((x, y))


def handwriting(seed: int, *, width: float, height: float, strokes: int = 24) -> Array:
    """(N, 2) [m] samples of a pen that are equal times apart, stretched along both axes to fill the box
    about the origin, as the map of two workspaces does.

    Every third stroke or so does more than to write on: it is a full loop, goes back sharply (cusp), crosses what was
    written, goes there and back on one line, or comes after a rest.
    """
    rng = np.random.default_rng(seed)
    made: list[Stroke] = []
    clock, heading, side = 0.1, float(rng.uniform(-1.0, 1.0)), 1.0

    def stroke(length: float, turn: float, *, apart: float) -> None:
        nonlocal clock, heading
        sigma = float(rng.uniform(0.2, 0.35))
        mu = math.log(float(rng.uniform(0.25, 0.45)))
        made.append(Stroke(clock, mu, sigma, length, heading, heading + turn))
        heading += turn
        clock += apart

    for _ in range(strokes):
        kind = str(rng.choice(KINDS, p=[0.45, 0.15, 0.12, 0.1, 0.1, 0.08]))
        size = float(rng.uniform(0.6, 1.4))
        side = -side if rng.uniform() < 0.7 else side
        if kind == "loop":
            stroke(1.5 * size, side * float(rng.uniform(1.7, 2.3)) * math.pi, apart=0.35)
        elif kind == "cusp":
            stroke(size, side * float(rng.uniform(0.0, 0.6)), apart=0.45)
            heading += math.pi + float(rng.uniform(-0.3, 0.3))
        elif kind == "cross":
            stroke(size, side * 0.9 * math.pi, apart=0.25)
            stroke(1.5 * size, side * 0.4 * math.pi, apart=0.3)
        elif kind == "double":
            stroke(size, 0.0, apart=0.7)
            heading += math.pi
            stroke(size, 0.0, apart=0.7)
        elif kind == "stop":
            clock += float(rng.uniform(0.3, 1.0))
            stroke(size, side * float(rng.uniform(0.3, 1.5)), apart=0.3)
        else:
            stroke(size, side * float(rng.uniform(0.3, 2.2)), apart=float(rng.uniform(0.12, 0.3)))
            heading += float(rng.uniform(-0.5, 0.5))
    path = pen_path(made, clock + 1.0)
    low, high = path.min(axis=0), path.max(axis=0)
    scale = np.array([width, height]) / np.maximum(high - low, 1e-9)
    return np.asarray((path - 0.5 * (low + high)) * scale)
