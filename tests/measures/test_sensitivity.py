"""What noise and slow sampling do to each measure: the numbers that docs/capabilities/scoring.md states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rehab_opt import measures
from rehab_opt.measures.samples import noise_of_derivative, white_noise
from tests.measures.yardstick import LENGTH, SEEDS, noisy, reach

Array = np.ndarray


def behind(points: Array, rate: float, cutoff: float | None) -> tuple[Array, Array, Array]:
    velocity = measures.hand_velocity(points, rate, cutoff_hz=cutoff)
    return measures.low_passed(points, rate, cutoff_hz=cutoff), velocity, np.linalg.norm(velocity, axis=1)


OF: dict[str, Callable[[Array, float, float | None], float]] = {
    "mean": lambda p, r, c: measures.mean_speed(behind(p, r, c)[1]),
    "peak": lambda p, r, c: measures.peak_speed(behind(p, r, c)[1]),
    "time": lambda p, r, c: measures.movement_time(behind(p, r, c)[2], r),
    "peaks": lambda p, r, c: float(measures.velocity_peaks(behind(p, r, c)[2], r)),
    "sparc": lambda p, r, c: measures.spectral_arc_length(behind(p, r, c)[2], r),
    "jerk": lambda p, r, c: measures.dimensionless_jerk(behind(p, r, c)[1], r),
    "ldlj": lambda p, r, c: measures.log_dimensionless_jerk(behind(p, r, c)[1], r),
    "raw length": lambda p, r, c: measures.path_length(p),
    "length": lambda p, r, c: measures.path_length(behind(p, r, c)[0]),
    "end": lambda p, r, c: measures.end_error(p, (LENGTH, 0.0)),
    "raw along": lambda p, r, c: measures.range_used(p)[0],
    "raw across": lambda p, r, c: measures.range_used(p)[1],
    "along": lambda p, r, c: measures.range_used(behind(p, r, c)[0])[0],
    "across": lambda p, r, c: measures.range_used(behind(p, r, c)[0])[1],
    "repeats": lambda p, r, c: measures.path_variability([p, 2 * reach(r)[1] - p]) / np.sqrt(2),
}
MM = 1e-3
# of, noise [mm], rate [Hz], cut-off [Hz], rest [s], ratio to (or difference from) the true value
RATIOS = [
    ("mean", 0.5, 100, 10, 0, 1.01), ("mean", 1.0, 100, 10, 0, 1.03), ("mean", 0, 25, None, 0, 1.0),
    ("peak", 0.5, 100, 10, 0, 1.03), ("peak", 1.0, 100, 10, 0, 1.07), ("peak", 0, 25, None, 0, 0.99),
    ("time", 0.5, 100, 10, 0, 1.11), ("time", 0.1, 100, 10, 0.5, 1.02), ("time", 0.5, 100, 10, 0.5, 2.21),
    ("time", 0, 25, None, 0, 1.02),
    ("peaks", 0.5, 100, 10, 0, 2.3), ("peaks", 0.1, 100, 10, 0, 1.0), ("peaks", 1.0, 100, 10, 0, 3.3),
    ("peaks", 0, 25, None, 0, 1.0),
    ("raw length", 0.5, 100, 10, 0, 1.13), ("raw length", 0.5, 200, 10, 0, 1.38), ("length", 0.5, 100, 10, 0, 1.01),
    ("jerk", 0, 25, None, 0, 1.01),
]  # fmt: skip
DIFFERENCES = [
    ("sparc", 0.5, 100, 10, 0.0, 0.01), ("sparc", 1.0, 100, 10, -0.03, 0.01), ("sparc", 0, 25, None, 0.0, 0.01),
    ("ldlj", 0.5, 100, 10, -5.0, 0.1), ("ldlj", 0.1, 100, 10, -2.0, 0.1),
    ("end", 0.5, 100, 10, 0.7 * MM, 0.05 * MM),
    ("raw along", 0.5, 100, 10, 1.0 * MM, 0.1 * MM), ("raw across", 0.5, 100, 10, 2.5 * MM, 0.1 * MM),
    ("along", 0.5, 100, 10, 0.4 * MM, 0.1 * MM), ("across", 0.5, 100, 10, 1.3 * MM, 0.1 * MM),
    ("along", 0, 25, None, 0.0, 1e-9),
    ("repeats", 0.5, 100, 10, 0.7 * MM, 0.05 * MM),
]  # fmt: skip


def mean(of: str, size: float, rate: float, cutoff: float | None, rest: float = 0.0) -> float:
    _, points = reach(rate, rest=rest)
    return float(np.mean([OF[of](noisy(points, size * MM, k), rate, cutoff) for k in range(SEEDS if size else 1)]))


def true(of: str, rate: float = 1000.0) -> float:
    return OF[of](reach(rate)[1], rate, None)


@pytest.mark.parametrize(("of", "size", "rate", "cutoff", "rest", "ratio"), RATIOS)
def test_ratio_that_noise_or_sampling_makes_is_the_one_stated(
    of: str, size: float, rate: float, cutoff: Any, rest: float, ratio: float
) -> None:
    clean = true(of, rate) if size else true(of)  # sampling has a row of its own
    assert mean(of, size, rate, cutoff, rest) / clean == pytest.approx(ratio, abs=0.006 if ratio < 2 else 0.06)


@pytest.mark.parametrize(("of", "size", "rate", "cutoff", "difference", "within"), DIFFERENCES)
def test_difference_that_noise_or_sampling_makes_is_the_one_stated(
    of: str, size: float, rate: float, cutoff: Any, difference: float, within: float
) -> None:
    assert mean(of, size, rate, cutoff) - true(of) == pytest.approx(difference, abs=within)


@pytest.mark.parametrize(("size", "cutoff", "times"), [(0.5, 10, 150), (0.1, 10, 7), (0.5, 6, 10)])
def test_dimensionless_jerk_is_mostly_noise(size: float, cutoff: float, times: float) -> None:
    assert mean("jerk", size, 100, cutoff) / true("jerk") == pytest.approx(times, rel=0.07)


def test_area_of_a_circle_with_noise_and_with_few_samples() -> None:
    def circle(count: int) -> Array:
        angle = 2 * np.pi * np.arange(count) / count
        return 0.1 * np.column_stack((np.cos(angle), np.sin(angle)))

    exact = np.pi * 0.01
    large = np.mean([measures.workspace_used(noisy(circle(100), 0.5 * MM, k)) for k in range(SEEDS)])
    assert large / measures.workspace_used(circle(100)) == pytest.approx(1.004, abs=1e-3)
    assert measures.workspace_used(circle(25)) / exact == pytest.approx(0.99, abs=1e-3)
    half = np.column_stack((np.cos(np.linspace(0, np.pi, 25)), np.sin(np.linspace(0, np.pi, 25))))
    assert measures.path_length(half) / np.pi == pytest.approx(0.999, abs=5e-4)


@pytest.mark.parametrize("rate", [50.0, 100.0, 240.0])
def test_noise_is_found_again_and_its_derivatives_foretold(rate: float) -> None:
    noise = np.random.default_rng(3).normal(0, 0.5 * MM, (100_000, 2))
    velocity = measures.hand_velocity(noise, rate)
    jerk = rate**2 * np.diff(velocity, 2, axis=0)
    smooth = measures.low_passed(noise, rate)
    assert white_noise(noise, smooth, rate, cutoff_hz=10) == pytest.approx(0.5 * MM, rel=0.01)
    for order, seen in ((1, velocity), (3, jerk)):
        assert noise_of_derivative(0.5 * MM, rate, cutoff_hz=10, order=order) == pytest.approx(seen.std(), rel=0.02)
    if rate == 100.0:
        assert velocity.std() == pytest.approx(9e-3, rel=0.05)
        assert measures.hand_velocity(noise, rate, cutoff_hz=None).std() == pytest.approx(35e-3, rel=0.02)
