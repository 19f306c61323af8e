"""Held, repeated and rounded samples, and those stamped since 1970, do not change how long a drive takes for a path."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rehab_opt import smooth_path

BOUNDS = {"velocity": 1.0, "acceleration": 5.0, "jerk": 60.0}
RATE = 100


def hand(time, seed):
    """Smooth reaches between places that are drawn, and a rest of half a second amid them."""
    rng = np.random.default_rng(seed)
    knots = np.linspace(0, 3, 7)
    way = CubicSpline(knots, 0.12 * rng.normal(size=(7, 3)), bc_type="clamped")
    return np.array([0.3, -0.2, 0.8]) + way(
        np.where(time < 3, time, np.clip(time - 0.5, 3, None)) if seed < 2 else time
    )


def passage(time, points, **more):
    found = smooth_path(time, points, **BOUNDS, **more)
    moved = np.abs(np.diff(found.positions, 3, axis=0)).max() / 1e-9
    assert moved <= BOUNDS["jerk"] * (1 + 1e-4)
    return found, found.times[-1] - found.times[0]


SAMPLED = {
    **{f"held {k} times": lambda row, k=k: row // k * k for k in (2, 3, 5, 8, 10)},
    **{
        f"{hz} Hz written at {RATE}": lambda row, hz=hz: np.floor(row * hz / RATE + 1e-9) * RATE / hz for hz in (30, 60)
    },
    "one row twice, all others later": lambda row: row - (row > 90) - (row > 170),
    "one row lost, the one before in its place": lambda row: row - (row == 90) - (row == 171),
}


@pytest.mark.parametrize(
    ("kind", "step"),
    [(kind, step) for kind in ("as it is", *SAMPLED) for step in (0.0, 1e-3, 1e-4) if not (step and "Hz" in kind)],
)
@pytest.mark.parametrize("seed", range(3))
def test_samples_held_and_rounded_are_passed_in_the_hands_own_time(kind, step, seed):
    row = np.arange(3 * RATE)
    _, seconds = passage(row / RATE, hand(row / RATE, seed))
    points = hand(SAMPLED.get(kind, lambda row: row)(row) / RATE, seed)
    points = np.round(points / step) * step if step else points
    found, other = passage(row / RATE, points)
    assert other == pytest.approx(seconds, rel=0.05)
    true = np.column_stack([np.interp(found.phase, row / RATE, axis) for axis in hand(row / RATE, seed).T])
    moves = np.abs(np.diff(hand(row / RATE, seed), axis=0)).max()
    assert np.abs(found.positions - true).max() < 0.8 * step + 2.5 * moves  # two rows twice are two samples late


@pytest.mark.parametrize("seed", range(3))
def test_seconds_since_1970_that_jitter_are_those_from_zero(seed):
    rng = np.random.default_rng(seed)
    time = np.sort(np.arange(0, 3, 0.01) + rng.uniform(-0.003, 0.003, 300))
    found, seconds = passage(time - time[0], hand(time, seed))
    since, other = passage(1.7e9 + time, hand(time, seed))
    assert other == pytest.approx(seconds, rel=0.01)
    np.testing.assert_allclose(since.times[:100], 1.7e9 + time[0] + found.times[:100], atol=1e-6)
    assert np.all(np.diff(since.phase) >= 0)


def test_a_pause_stays_and_a_path_that_nothing_is_wrong_with_is_itself():
    """Held samples, then a stand of 0.6 s, which is no sample that is held."""
    time = np.arange(0, 3, 0.01)
    rest = np.clip(time, None, 1.0) + np.clip(time - 1.6, 0, None)
    points = 0.2 * np.column_stack([np.sin(np.pi * rest), 1 - np.cos(np.pi * rest)])[np.arange(300) // 2 * 2]
    found, _ = passage(time, points)
    there = np.abs(found.positions - points[130]).max(axis=1) < 2e-3
    assert np.sum(there) * 1e-3 > 0.5
    corner = np.column_stack(
        [np.r_[np.linspace(0, 1, 101), np.ones(100)], np.r_[np.zeros(101), np.linspace(0.01, 1, 100)]]
    )
    found, _ = passage(np.arange(201) / 100, 0.3 * corner)  # a grid of 3 mm, and no rounding
    assert found.deviation.max() <= 1e-4
    assert np.abs(found.positions - np.clip(found.positions, 0, 0.3)).max() < 1e-9
    waypoints = np.array([[0.0, 0.0], [0.3, 0.1], [0.3, 0.1], [0.1, 0.4]])
    found, _ = passage(np.arange(4.0), waypoints)
    assert np.sum(np.abs(found.positions - waypoints[1]).max(axis=1) < 1e-3) * 1e-3 > 0.9
