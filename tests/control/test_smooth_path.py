"""Whole paths for a drive: kept, retimed, and within every bound in every tick."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import linprog

from rehab_opt.control.path_timing import PathCells, ruckig_timing
from rehab_opt.control.smoothing import smooth_path
from tests.control.test_smoothing import A, J, V
from tests.refusals import refuses


def assert_axes_keep(timing, path, velocity, acceleration, jerk):
    """By the chain rule, from the pieces of the progress."""
    part = np.linspace(0, 1, 9)[:-1, None]
    since = (part * np.diff(timing.times)).ravel()
    s, v, a, j = np.tile(timing.pieces, 8)
    s, v, a = s + since * (v + since * (a / 2 + since * j / 6)), v + since * (a + since * j / 2), a + since * j
    order = np.argsort(np.tile(timing.times[:-1], 8) + since, kind="stable")
    assert np.all(np.diff(s[order]) >= -1e-12)
    first, second, third = (path(s, order) for order in (1, 2, 3))
    v, a, j = v[:, None], a[:, None], j[:, None]
    assert np.all(np.abs(first * v) <= velocity * (1 + 1e-6))
    assert np.all(np.abs(first * a + second * v**2) <= acceleration * (1 + 1e-6))
    assert np.all(np.abs(first * j + 3 * second * v * a + third * v**3) <= jerk * (1 + 1e-6))


@pytest.mark.parametrize("seed", range(2))
def test_a_linear_programme_finds_no_timing_that_is_much_faster(seed):
    """Over the squares of the pace, linear in each cell, with the bounds at 9 places of it."""
    rng = np.random.default_rng(seed)
    n, count = 3, 120
    path = PchipInterpolator(np.linspace(0, 1, 6), rng.standard_normal((6, n)), axis=0)
    velocity, acceleration = rng.uniform(0.5, 2, n), rng.uniform(2, 8, n)
    knots = np.append(np.concatenate([np.linspace(a, b, count // 5, endpoint=False) for a, b in pairwise(path.x)]), 1.0)
    cells = PathCells(knots, *(path.derivative(order)(knots[:-1]) for order in (1, 2, 3)))
    timing = ruckig_timing(cells, velocity=velocity, acceleration=acceleration, fastest=1.0)
    rows, most, top = [], [], np.ones(count + 1)
    for k in range(count):
        for fraction in np.linspace(1e-9, 1 - 1e-9, 9):
            s = knots[k] + fraction / count
            first, second = path(s, 1), path(s, 2)
            for i in range(n):
                row = np.zeros(count + 1)
                row[k], row[k + 1] = -first[i] * count / 2, first[i] * count / 2
                row[k] += second[i] * (1 - fraction)
                row[k + 1] += second[i] * fraction
                rows += [row, -row]
                most += [acceleration[i]] * 2
            top[k : k + 2] = np.minimum(top[k : k + 2], ((velocity / np.maximum(np.abs(first), 1e-9)) ** 2).min())
    top[[0, -1]] = 0.0
    best = linprog(-np.ones(count + 1), A_ub=np.array(rows), b_ub=most, bounds=np.stack([0 * top, top], axis=1))
    assert best.success
    quickest = np.sum(2 / count / (np.sqrt(best.x[1:]) + np.sqrt(best.x[:-1])))
    assert_axes_keep(timing, path, velocity, acceleration, np.inf)
    assert 0.95 * quickest <= timing.times[-1] <= 1.15 * quickest


@pytest.mark.parametrize("bounded", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_axes_keep_their_bounds_at_every_instant_of_the_passage(seed, bounded):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    path = CubicSpline(np.linspace(0, 1, 8), rng.standard_normal((8, n)), bc_type="clamped")
    velocity, acceleration = rng.uniform(0.5, 2, n), rng.uniform(2, 8, n)
    jerk = 10 ** rng.uniform(1, 3, n) if bounded else np.full(n, np.inf)
    knots = np.linspace(0, 1, 7 * 40 + 1)
    cells = PathCells(knots, *(path.derivative(order)(knots[:-1]) for order in (1, 2, 3)))
    timing = ruckig_timing(cells, velocity=velocity, acceleration=acceleration, jerk=jerk)
    assert_axes_keep(timing, path, velocity, acceleration, jerk)
    assert timing.at(timing.times[[0, -1]]).tolist() == [0.0, 1.0]
    assert np.abs(timing.at(timing.times[-1:] * (1 - 1e-9)) - 1.0).max() < 1e-6


def test_what_no_drive_can_use_is_refused_by_name():
    usual = {"times": [0.0, 1.0, 2.0], "points": [[0.0], [1.0], [0.5]], "velocity": V, "acceleration": A, "jerk": J}
    settings = [
        ("dt", "x"), ("dt", 0.0), ("dt", 1e-300), ("velocity", "x"), ("lower", "x"), ("tolerance", 0.0),
        ("tolerance", math.nan), ("tolerance", 1e-300), ("velocity", 1e-300), ("acceleration", 1e-300),
        ("jerk", 1e-300), ("times", [0.0, 0.0]), ("times", [0.0, math.nan]), ("times", [0.0, 10**400]), ("times", "a"),
        ("points", [[0.0], [math.inf]]), ("points", [0.0, 1.0]), ("points", [[0.0]]), ("points", "a"),
        ("points", [[0.0], [1.0, 2.0]]),
    ]  # fmt: skip
    refuses(smooth_path, *(({**usual, name: value}, name.rstrip("s")) for name, value in settings))
    refuses(smooth_path, ({**usual, "times": [0.0], "points": [[0.0]]}, "times"))
