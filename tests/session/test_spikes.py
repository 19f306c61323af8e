"""A sensor's spikes are found wherever they are, and nothing else is taken for one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rehab_opt.recordings.recording import Recording, without_spikes
from rehab_opt.session.scoring import score_recordings
from tests.measures.yardstick import reach

RATES = (20.0, 50.0, 100.0, 250.0, 1000.0)


def smooth(rng: np.random.Generator, rate: float, *, hz: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(N,) [s] and (N, 2 or 3) [m]: harmonics of a hand's pace, with a sensor's noise."""
    time = np.arange(int(rng.integers(400, 900))) / rate
    points = np.zeros((len(time), int(rng.integers(2, 4))))
    for k in range(1, 4):
        size, phase = rng.normal(0.0, 0.05 / k, points.shape[1]), rng.uniform(0, 2 * np.pi, points.shape[1])
        points += size * np.sin(2 * np.pi * hz * rng.uniform(0.2, 0.4) * k * time[:, None] + phase)
    return time, points + rng.normal(0.0, float(rng.choice([1e-4, 1e-3])), points.shape)


def off(rng: np.random.Generator, rate: float, width: int, coordinates: int) -> np.ndarray:
    """(width, coordinates) [m] at one other place, or each sample at its own.

    at 20 Hz a hand itself goes aside by 0.2 m, in three by 1 m."""
    way = rng.normal(size=(width, coordinates))
    if rng.random() < 0.5:
        way[:] = way[0]
    size = rng.uniform(1.0, 3.0) if rate < 50 else rng.uniform(0.15, 3.0)
    return np.asarray(size * way / np.linalg.norm(way, axis=1, keepdims=True))


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("place", ["start", "inside", "end"])
def test_exactly_the_spikes_are_left_out(rate: float, place: str) -> None:
    """Ten in a row were kept and ten good ones around left out; of a first or last sample five good ones."""
    for seed in range(30):
        rng = np.random.default_rng([seed, int(rate), len(place)])
        time, points = smooth(rng, rate)
        time = time + rng.uniform(0.0, 0.5, len(time)) / rate  # when they arrived
        width = int(rng.integers(1, 13))
        first = {"start": 0, "end": len(time) - width}.get(place, int(rng.integers(15, len(time) - 30)))
        bad = np.arange(first, first + width)
        spoilt = points.copy()
        spoilt[bad] += off(rng, rate, width, points.shape[1])
        found = without_spikes(Recording("a", time, spoilt))
        np.testing.assert_array_equal(found.time, np.delete(time, bad), err_msg=f"{seed}")
        assert found.notes == (f"samples left out as spikes: {width}, the first after {time[first] - time[0]:.3g} s",)


@pytest.mark.parametrize("rate", RATES)
def test_a_fast_movement_loses_no_sample(rate: float) -> None:
    """Up to 4 m/s and 30 m/s^2."""
    for seed in range(30):
        time, points = smooth(np.random.default_rng([seed, int(rate)]), rate, hz=3.0)
        speed = np.linalg.norm(np.diff(points, axis=0), axis=1).max() * rate
        found = without_spikes(Recording("a", time, points * min(1.0, 4.0 / speed)))
        np.testing.assert_array_equal(found.time, time)
        assert found.notes == ()


@pytest.mark.parametrize("stair", [0, 10])
def test_a_jump_that_is_no_spike_is_told(stair: int) -> None:
    """The hand stays where it jumped to, at once or by way of a third place."""
    time, points = smooth(np.random.default_rng(5), 100.0)
    points[200:] += 1.0
    points[200 : 200 + stair] -= 0.5
    found = without_spikes(Recording("a", time, points))
    np.testing.assert_array_equal(found.points, points)
    (note,) = found.notes
    assert "a jump that is no spike: " in note
    assert "after 2 s" in note


def spoilt(folder: Path) -> str:
    """A recording of 6 s with a spike of 40 mm and a hole of a second."""
    time, points = reach(100, rest=2.0)
    points[250] += 0.04
    rows = [f"{t:.6f},{x:.9f},{y:.9f}" for t, (x, y) in zip(time, points, strict=True)]
    del rows[60:160]
    file = folder / "spoilt.csv"
    file.write_text("\n".join(["t_s,x_m,y_m", *rows]))
    return str(file)


def test_a_score_leaves_spikes_out_and_says_so(tmp_path: Path) -> None:
    """One sample 40 mm off made a movement of 3.6 s one of 0.1 s, without a word."""
    file = spoilt(tmp_path)
    scored = score_recordings([file])
    times = [row.value for row in scored.rows if row.measure == "movement_time"]
    assert times == pytest.approx([np.sqrt(1 - np.sqrt(0.05))], abs=2e-3)
    assert f"{file}: samples left out as spikes: 1, the first after 2.5 s" in scored.notes
