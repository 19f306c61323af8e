"""Clinical measures against closed forms, and what they say of recordings that cannot be measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import spherical_jn

from rehab_opt import measures
from rehab_opt.errors import ConfigurationError
from rehab_opt.measures import score
from rehab_opt.measures.speed import THRESHOLD
from tests.measures.yardstick import LENGTH, SECONDS, noisy, reach

seeds = st.integers(0, 2**32 - 1)


SHARES = np.linspace(0.0, 1.0, 1001)


def reaches_in_a_row(count: int) -> np.ndarray:
    return np.concatenate([minimum_jerk_speed(np.linspace(0, 1, 500)) for _ in range(count)])


def minimum_jerk_speed(u: np.ndarray) -> np.ndarray:
    return 30 * (u * (1 - u)) ** 2


def values(scored: measures.Score) -> dict[str, float]:
    return {measure.name: measure.value for measure in scored.measures}


# ------------------------------------------------------------------------------------------------------------ speed
def test_minimum_jerk_reach_peaks_at_1_875_times_its_mean_speed() -> None:
    _, points = reach(2000)
    velocity = measures.hand_velocity(points, 2000, cutoff_hz=None)
    assert measures.peak_speed(velocity) == pytest.approx(1.875 * LENGTH / SECONDS, rel=1e-6)
    assert measures.peak_speed(velocity) / measures.mean_speed(velocity) == pytest.approx(1.875, rel=1e-3)


@pytest.mark.parametrize("samples", [26, 31, 101])
def test_mean_speed_is_way_over_time_however_it_was_sampled(samples: int) -> None:
    even = np.linspace(0, 1, samples)
    assert measures.mean_speed(minimum_jerk_speed(even)) == pytest.approx(1, rel=1e-5)
    uneven = even + 0.3 / samples * np.sin(7 * np.arange(samples)) * (even * (1 - even) > 0)
    assert measures.mean_speed(minimum_jerk_speed(uneven), uneven) == pytest.approx(1, rel=0.01)
    assert measures.mean_speed([[3.0, 4.0]]) == pytest.approx(5.0)


@pytest.mark.parametrize("threshold", [0.01, 0.05, 0.2])
def test_minimum_jerk_movement_time_is_its_closed_form(threshold: float) -> None:
    speed = minimum_jerk_speed(np.linspace(0, 1, 501))
    lasted = math.sqrt(1 - math.sqrt(threshold))
    begin, end = measures.movement_interval(speed, 500 / SECONDS, threshold=threshold)
    assert begin == pytest.approx((1 - lasted) / 2, abs=1e-4)
    assert end == pytest.approx((1 + lasted) / 2, abs=1e-4)
    assert measures.movement_time(speed, 500, threshold=threshold) == pytest.approx(lasted, abs=2e-4)


def test_ripples_lower_than_the_rise_and_peaks_closer_than_apart_are_no_peaks() -> None:
    time = np.linspace(0, 1, 501)
    ripple, waves = np.sin(2 * np.pi * 8 * time), 1 - 0.1 * np.cos(2 * np.pi * 8 * time)
    speed = minimum_jerk_speed(time)
    assert measures.velocity_peaks(speed + 0.005 * ripple, 500) == 1
    assert measures.velocity_peaks(np.tile(speed, 3), 500) == 3
    assert measures.velocity_peaks(waves, 500, apart=0.05) == 8
    assert measures.velocity_peaks(waves, 500, apart=0.15) == 4  # 125 ms apart: each second one


# ------------------------------------------------------------------------------------------------------- smoothness
def minimum_jerk_arc_length() -> float:
    """Of the Fourier transform of 30 u^2 (1 - u)^2, which is 15 j_2(w) / w^2 with w = pi f T, in closed form."""

    def amplitude(w: float) -> float:
        return 15.0 * float(spherical_jn(2, w)) / w**2

    def slope(w: float) -> float:
        return -15.0 * float(spherical_jn(3, w)) / w**2

    end = brentq(lambda w: amplitude(w) - THRESHOLD, 2.0, 5.5)
    return -float(quad(lambda w: math.hypot(1.0 / end, slope(w) if w > 1e-9 else 0.0), 0.0, end)[0])


@pytest.mark.parametrize(("count", "seconds"), [(1001, 1.0), (301, 1.0), (3001, 3.0), (101, 0.5)])
def test_sparc_of_a_minimum_jerk_reach_is_its_closed_form(count: int, seconds: float) -> None:
    speed = minimum_jerk_speed(np.linspace(0, 1, count))
    assert minimum_jerk_arc_length() == pytest.approx(-1.408, abs=1e-3)
    assert measures.spectral_arc_length(speed, (count - 1) / seconds) == pytest.approx(
        minimum_jerk_arc_length(), abs=0.01
    )


@pytest.mark.parametrize("width", [0.05, 0.1, 0.3])
def test_sparc_of_a_gaussian_speed_is_the_length_of_a_gaussian(width: float) -> None:
    """Its spectrum is exp(-2 (pi width f)^2): the arc up to where that is 0.05, by quadrature."""
    time = np.arange(-8 * width, 8 * width, 0.002)
    end = math.sqrt(math.log(1 / THRESHOLD) / 2) / (math.pi * width)
    assert end < 10
    square = 2 * (math.pi * width) ** 2
    arc = quad(lambda f: math.hypot(1 / end, 2 * square * f * math.exp(-square * f * f)), 0, end)[0]
    assert measures.spectral_arc_length(np.exp(-((time / width) ** 2) / 2), 500) == pytest.approx(-arc, abs=5e-3)


@settings(max_examples=40, deadline=None)
@given(scale=st.floats(1e-6, 1e6), rate=st.floats(100.0, 2000.0))
def test_smoothness_does_not_depend_on_the_unit_of_speed_nor_on_duration(scale: float, rate: float) -> None:
    speed = reaches_in_a_row(2)
    # The two reaches in 0.5 to 10 s: up to the threshold their spectrum lies below the cut-off.
    assert measures.spectral_arc_length(scale * speed, rate) == pytest.approx(
        measures.spectral_arc_length(speed, 1000.0), rel=1e-9
    )


def test_frequencies_above_ten_hertz_do_not_count() -> None:
    calm = minimum_jerk_speed(SHARES)
    shaken = calm + 0.5 * np.sin(2 * np.pi * 60.0 * SHARES)
    assert measures.spectral_arc_length(shaken, 1000.0) == pytest.approx(
        measures.spectral_arc_length(calm, 1000.0), abs=0.02
    )


@settings(max_examples=20, deadline=None)
@given(length=st.floats(1e-3, 10), seconds=st.floats(0.1, 30), turn=st.floats(-3, 3))
def test_minimum_jerk_reach_has_a_dimensionless_jerk_of_204_8(length: float, seconds: float, turn: float) -> None:
    speed = length / seconds * minimum_jerk_speed(np.linspace(0, 1, 401))
    velocity = np.outer(speed, (math.cos(turn), math.sin(turn)))
    expected = 720 / 1.875**2
    assert measures.dimensionless_jerk(velocity, 400 / seconds) == pytest.approx(expected, rel=1e-3)
    assert measures.dimensionless_jerk(speed, 400 / seconds) == pytest.approx(expected, rel=1e-3)
    assert measures.log_dimensionless_jerk(speed, 400 / seconds) == pytest.approx(-math.log(expected), abs=1e-3)


def test_jerk_of_a_circle_is_its_turning_and_of_its_speed_nothing() -> None:
    """With v = omega r, |jerk| = omega^2 v: D^3 / v^2 * omega^4 v^2 D = (omega D)^4, a turn being (2 pi)^4."""
    angle = np.linspace(0, 2 * math.pi, 2001)
    velocity = 0.3 * np.column_stack((-np.sin(angle), np.cos(angle)))
    assert measures.dimensionless_jerk(velocity, 2000 / 1.7) == pytest.approx((2 * math.pi) ** 4, rel=1e-4)
    assert measures.dimensionless_jerk(np.full(2001, 0.3), 1000) == pytest.approx(0.0, abs=1e-12)
    assert measures.log_dimensionless_jerk(np.full(2001, 0.25), 1000) == math.inf


# ------------------------------------------------------------------------------------------------------------- path
def test_half_circle_is_half_pi_times_its_diameter() -> None:
    angle = np.linspace(0, math.pi, 2001)
    half = np.column_stack((np.cos(angle), np.sin(angle)))
    assert measures.path_length(0.2 * half) == pytest.approx(0.2 * math.pi, rel=1e-6)
    assert measures.path_ratio(half) == pytest.approx(math.pi / 2, rel=1e-6)
    assert measures.path_ratio(half, 2 * half) == pytest.approx(0.5)
    assert math.isnan(measures.path_ratio(np.vstack((half, half[::-1]))))


@settings(max_examples=40, deadline=None)
@given(seed=seeds)
def test_workspace_is_the_area_of_the_hull_and_the_volume_of_a_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(3, 40), 2)) * rng.uniform(1e-3, 10)
    assert measures.workspace_used(points) == pytest.approx(shapely.MultiPoint(points).convex_hull.area, rel=1e-9)
    for flat in (np.outer(np.arange(3), [1, 1]), points[:, [0, 1, 1]] * [1, 1, 0]):  # on a line, in a plane of space
        assert measures.workspace_used(flat) == 0.0
    sides = rng.uniform(0.01, 2, 3)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * sides
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    filled = np.vstack((corners, rng.uniform(0, 1, (20, 3)) * sides))
    assert measures.workspace_used(filled @ turn.T + rng.normal(size=3)) == pytest.approx(sides.prod(), rel=1e-9)


def test_variability_is_that_of_repeats_shifted_by_a_known_spread() -> None:
    _, points = reach(100)
    shifts = np.array([-0.02, 0.0, 0.02])
    trials = [points + (0.0, shift) for shift in shifts]
    assert measures.path_variability(trials) == pytest.approx(0.02)  # the standard deviation of -1, 0, 1 is 1
    assert measures.end_variability(trials) == pytest.approx(0.02)


# --------------------------------------------------------------------------------------------------- from recordings
@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_score_is_the_same_wherever_and_however_turned_the_movement_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time, points = reach(100, rest=0.3, axes=3)
    points[:, 1] += 0.05 * np.sin(8 * time) * np.ptp(points[:, 0])
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    here, there = score(time, points), score(time + rng.uniform(-1e3, 1e3), points @ turn.T + rng.normal(size=3))
    moved = {name: value for name, value in values(there).items() if not name.startswith("range")}
    for name, value in moved.items():
        assert value == pytest.approx(values(here)[name], rel=1e-4, abs=1e-9), name


def test_score_measures_the_movement_and_not_the_rest_around_it() -> None:
    short, long = (values(score(*reach(100, rest=rest))) for rest in (0.2, 1.0))
    assert long.pop("duration") == pytest.approx(short.pop("duration") + 1.6)
    assert long == pytest.approx(short, rel=1e-4, abs=1e-9)
    assert short["movement_time"] == pytest.approx(0.8814, abs=1e-3)
    assert short["speed_peak"] == pytest.approx(0.375, rel=1e-3)
    lasted = math.sqrt(1 - math.sqrt(0.05))
    jerk = quad(lambda u: (60 - 360 * u + 360 * u * u) ** 2, (1 - lasted) / 2, (1 + lasted) / 2)[0]
    assert short["dimensionless_jerk"] == pytest.approx(jerk * lasted**3 / 1.875**2, rel=0.01)
    assert short["path_ratio"] == pytest.approx(1.0, abs=1e-9)


def test_filter_leaves_half_the_power_at_its_cut_off_and_adds_no_delay() -> None:
    time = np.arange(4000) / 400
    wave = np.sin(2 * np.pi * 10 * time)[:, None]
    inner = measures.low_passed(wave, 400, cutoff_hz=10)[1000:3000, 0]
    fitted = np.linalg.lstsq(
        np.column_stack((np.sin(2 * np.pi * 10 * time), np.cos(2 * np.pi * 10 * time)))[1000:3000], inner, rcond=None
    )[0]
    assert fitted[0] == pytest.approx(math.sqrt(0.5), abs=5e-3)
    assert fitted[1] == pytest.approx(0.0, abs=1e-9)


def test_uneven_samples_are_made_even_and_gaps_are_noted() -> None:
    rng = np.random.default_rng(7)
    time = np.sort(rng.uniform(0, 1, 3000))
    even = measures.evenly_sampled(time, np.column_stack((time, -2 * time)), rate_hz=50)
    np.testing.assert_allclose(even.points[:, 1], -2 * even.points[:, 0])
    np.testing.assert_allclose(np.diff(even.time), 0.02)
    time, points = reach(100)
    kept = (np.arange(101) < 40) | (np.arange(101) > 60)
    notes = score(time[kept], points[kept]).notes
    assert notes[0].startswith("a gap of 220 ms (usual: 10 ms) bridged by straight lines")


def test_jittered_stamps_are_no_gaps_and_a_sample_left_out_is() -> None:
    time, points = reach(100)
    stamps = time + np.random.default_rng(17).uniform(-3e-3, 3e-3, 101)
    (note,) = measures.evenly_sampled(stamps, points).notes
    assert note.startswith("steps of ")
    kept = (np.arange(101) < 40) | (np.arange(101) > 42)
    assert measures.evenly_sampled(stamps[kept], points[kept]).notes[0].startswith("a gap of ")


@pytest.mark.parametrize(("left_out", "told"), [((40, 43), True), ((40, 60), False), ((-40, -20), True)])
def test_jerk_over_a_gap_is_none_of_the_person_s(left_out: tuple[int, int], told: bool) -> None:
    time, points = reach(100, rest=0.5)
    number = np.arange(len(time)) - 50
    kept = (number < left_out[0]) | (number >= left_out[1])  # of the last of them, the person was at rest
    scored = score(time[kept], points[kept])
    measured = values(scored)
    for name in ("dimensionless_jerk", "log_dimensionless_jerk"):
        assert math.isfinite(measured[name]) == told
    assert any("not over a gap of 210 ms" in note for note in scored.notes) != told


def test_what_may_be_noise_is_noted() -> None:
    time, points = reach(100, rest=0.5)
    assert score(time, points).notes == ()
    little = score(time, noisy(points, 1e-4, 1)).notes
    assert [note.partition(" mm")[0] for note in little] == ["noise of 0.094"]
    assert "dimensionless_jerk" in little[0]
    much = " ".join(score(time, noisy(points, 5e-4, 1)).notes)
    assert "noise of 0.47 mm may move a hand at rest at 39 mm/s: the movement is cut at 10 % of its peak speed" in much
    assert "noise of 0.47 mm may make up all of dimensionless_jerk" in much


@pytest.mark.parametrize("rate", [20, 25, 50, 100, 200, 1000])
def test_noise_at_rest_is_no_movement_at_any_rate(rate: float) -> None:
    time, points = reach(rate, rest=0.5)
    clean = values(score(time, points))
    for seed in range(10):
        scored = score(time, noisy(points, 5e-4, seed))
        seen = values(scored)
        assert seen["movement_time"] == pytest.approx(clean["movement_time"], rel=0.15), seed
        assert seen["speed_mean"] == pytest.approx(clean["speed_mean"], rel=0.15)
        assert seen["velocity_peaks"] == 1
        assert not any("in motion" in note for note in scored.notes)
        assert any("dimensionless_jerk" in note for note in scored.notes)


@pytest.mark.parametrize("rate", [20, 25, 50, 100, 200, 1000])
@pytest.mark.parametrize("axes", [2, 3])
def test_noise_is_no_movement_of_a_hand_that_rests_throughout(rate: float, axes: int) -> None:
    time, points = reach(rate, rest=1.5, axes=axes)
    for seed in range(10):
        with pytest.raises(
            ConfigurationError, match=r"mm/s'.*and otherwise than noise of 0\.[3-8]\d* mm makes one at rest"
        ):
            score(time, noisy(0 * points, 5e-4, seed))
        assert values(score(3 * time, noisy(points / 4, 5e-4, seed)))["range_x"] > 0.045  # 50 mm in 3 s: 31 mm/s


def test_what_is_cut_off_or_comes_back_is_noted() -> None:
    time, points = reach(100)
    cut = score(time[:70], points[:70])
    assert cut.notes[0].startswith("the trial ends in motion, at 7")
    back = score(np.arange(202) / 100, np.vstack((points, points[::-1])))
    assert math.isnan(values(back)["path_ratio"])
    assert any(note.startswith("path_ratio: ") for note in back.notes)
    slow = score(*reach(20))
    assert slow.notes[0] == "sampled at 20 Hz, too slowly for a low-pass at 10 Hz: not filtered (one below 8 Hz can be)"


def test_joints_turn_and_do_not_jump() -> None:
    time, points = reach(100)
    elbow = (np.linspace(3.0, 3.5, 101) + np.pi) % (2 * np.pi) - np.pi
    assert values(score(time, points, joints={"elbow": elbow}))["range_elbow"] == pytest.approx(math.degrees(0.5))


TIME, POINTS = reach(100)
BROKEN = np.where(np.arange(101)[:, None] == 40, np.nan, POINTS)
TWICE = np.where(np.arange(101) == 50, TIME[49], TIME)
BAD: list[tuple[Callable[[], Any], str]] = [
    (lambda: score(TIME, BROKEN), "points[40, 0]"),
    (lambda: score(np.where(TIME > 0.5, np.inf, TIME), POINTS), "time[51]"),
    (lambda: score(TIME[::-1], POINTS), "time[1]"),
    (lambda: score(TIME[:9], POINTS[:9]), "time"),
    (lambda: score(TIME, POINTS[:, 0]), "points"),
    (lambda: score(TIME, 0 * POINTS), "points"),
    (lambda: score(TIME, 1e-3 * POINTS), "points"),  # 0.4 mm/s
    (lambda: score(TIME, POINTS, target=(1, 2, 3)), "target"),
    (lambda: score(TIME, POINTS, cutoff_hz=500.0), "cutoff_hz"),
    (lambda: score(1e-3 * TIME, POINTS), "points"),  # seconds taken for milliseconds
    (lambda: score(TIME, POINTS, threshold=math.nan), "threshold"),
    (lambda: score(TIME, POINTS, joints={"elbow": [math.nan]}), "joints['elbow'][0]"),
    (lambda: score([*TIME[:-1], 1e9], POINTS), "rate_hz"),
    (lambda: measures.hand_velocity(POINTS, 1e12), "cutoff_hz"),  # times in another unit
    (lambda: measures.hand_velocity(POINTS, 0.0), "rate_hz"),
    (lambda: measures.spectral_arc_length([], 1.0), "speed"),
    (lambda: measures.spectral_arc_length([math.nan], 1.0), "speed[0]"),
    (lambda: measures.dimensionless_jerk(POINTS[:6], 100), "velocity"),
    (lambda: measures.movement_interval(np.zeros(5), 100), "speed"),
    (lambda: measures.velocity_peaks(POINTS, 100), "speed"),
    (lambda: measures.velocity_peaks([1.0, 2.0], 100, rise=0), "rise"),
    (lambda: measures.mean_speed([1.0, 2.0], [0.0]), "time"),
    (lambda: measures.path_variability([POINTS]), "trials"),
    (lambda: measures.end_variability([POINTS, BROKEN]), "trials[1][40, 0]"),
]  # fmt: skip


@pytest.mark.parametrize(("measured", "argument"), BAD)
def test_what_cannot_be_measured_is_refused_by_name(measured: Callable[[], Any], argument: str) -> None:
    with pytest.raises(ConfigurationError) as refused:
        measured()
    assert refused.value.argument == argument
