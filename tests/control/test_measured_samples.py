"""Held, repeated and rounded samples, and those stamped since 1970, do not change how long a drive takes for a path."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rehab_opt import smooth_path
from rehab_opt.kinematics.measured_path import measured_path

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


def lissajous(time, seed):
    """Curves, and reaches of least jerk from rest to rest, which the rule was not set by."""
    rng = np.random.default_rng(seed)
    turns, part = rng.uniform(1.0, 2.5, 3), np.clip(time / 1.3 % 2, 0, 1)
    reach = part**3 * (10 + part * (6 * part - 15)) + np.floor(time / 2.6)
    wave = 0.15 * np.sin(turns * time[:, None] + rng.uniform(0, 6, 3))
    return 0.1 * rng.normal(size=3) * reach[:, None] if seed % 2 else wave


@pytest.mark.parametrize("seed", range(20, 26))
@pytest.mark.parametrize(
    ("hz", "tracker"), [(100, 120), (100, 104), (250, 300), (60, 72), (72, 90), (125, 200), (100, 190), (80, 131)]
)
def test_a_tracker_faster_than_its_logger_leaves_the_time_as_it_is(hz, tracker, seed):
    row = np.arange(int(3.7 * hz))
    _, seconds = passage(row / hz, lissajous(row / hz, seed))
    _, other = passage(row / hz, lissajous(np.floor(row * tracker / hz + 1e-9) / tracker, seed))
    assert other == pytest.approx(seconds, rel=0.05)


@pytest.mark.parametrize("seed", range(30, 36))
@pytest.mark.parametrize(("hz", "part", "noise"), [(60, 0.03, 0), (128, 0.03, 0), (128, 0.1, 0), (200, 0, 2e-4)])
def test_jitter_and_noise_leave_the_time_as_it_is(hz, part, noise, seed):
    rng, row = np.random.default_rng(seed), np.arange(int(3.7 * hz))
    _, seconds = passage(row / hz, lissajous(row / hz, seed))
    off = rng.uniform(-part, part, len(row))
    for stamps, samples in ((row + off, row), (row, row + off)):
        points = lissajous(samples / hz, seed) + noise * rng.normal(size=(len(row), 3))
        found, other = passage(stamps / hz, points)
        assert other == pytest.approx(seconds, rel=0.05)
        assert np.abs(found.positions - lissajous(found.phase, seed)).max() < 1e-4 + 1.2 * part / hz + 5 * noise


def test_corners_of_a_planned_path_are_no_noise():
    corners = np.array([[0, 0], [0.2, 0.05], [0.1, 0.3], [0.4, 0.2], [0.3, 0.0]])
    points = np.vstack([np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(corners)])
    for measured in (True, False):
        found, _ = passage(np.arange(80) / 20, points, measured=measured)
        assert np.abs(found.positions - np.clip(found.positions, 0, 0.4)).max() < 1e-9
        assert max(np.abs(found.positions - corner).max(axis=1).min() for corner in corners[:-1]) < 2e-3
    noisy = points + 1e-3 * np.random.default_rng(3).normal(size=points.shape)
    assert passage(np.arange(80) / 20, noisy, measured=False)[0].deviation.max() <= 1e-4


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


@pytest.mark.parametrize("apart", [1e-9, 1e-6, 1e-5])
@pytest.mark.parametrize("clock", [0.016, 0.02])
def test_times_of_a_coarse_clock_that_hardly_differ_are_one_time(apart, clock):
    """A raw LinAlgError was raised, or the path took hours."""
    time = np.arange(3 * RATE) / RATE
    ticks = np.arange(0, time[-1] + 1e-9, clock)
    _, seconds = passage(ticks, hand(ticks, 2))
    stamps = np.floor(time / clock + 1e-9) * clock + apart * np.arange(len(time))
    found, other = passage(stamps, hand(time, 2))
    assert other == pytest.approx(seconds, rel=0.02)
    np.testing.assert_allclose(found.positions[-1], hand(time, 2)[-1], atol=1e-9)


@pytest.mark.parametrize(("more", "left_out"), [(1, True), (3, True), (4, False), (10, False)])
def test_a_single_sample_repeated_more_than_three_times_is_a_pause(more, left_out):
    time = np.arange(3 * RATE) / RATE
    points = hand(time, 2)
    points[150 : 151 + more] = points[150]
    assert any("repeat the one before" in note for note in measured_path(time, points).notes) is left_out
