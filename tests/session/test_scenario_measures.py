"""Measures of a trial, on trials whose answers are known; smoothness and speed: tests/measures."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.control.command import Status
from rehab_opt.control.gate import Mode
from rehab_opt.measures.along_path import projected
from rehab_opt.session.scenario.measures import law_summary, time_to_zero_force, trial_measures
from rehab_opt.session.trace import Trace
from tests.session.made_trials import LINE, WITHIN, made_outcome, trial_of

MODES: tuple[Mode, ...] = ("stretch", "assist", "resist", "follow", "hold")
ALONG = np.column_stack((np.linspace(0.0, 0.2, 101), np.full(101, 0.45)))
"""From end to end of `LINE` in 1 s."""
STILL = np.zeros((101, 2))


def measured(trial: Trace, mode: Mode = "assist", *, target: Any = LINE[-1], reference: Any = LINE) -> dict[str, Any]:
    return trial_measures(trial, reference=reference, mode=mode, target=target, within=WITHIN)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_distance_to_a_path_is_the_least_over_all_of_its_segments(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path, points = rng.uniform(-1, 1, (rng.integers(1, 12), 2)), rng.uniform(-1.5, 1.5, (20, 2))
    path = np.repeat(path, rng.integers(1, 3, len(path)), axis=0)
    found = projected(points, path)
    fractions = np.linspace(0, 1, 2001)[:, None]
    pieces = [a + fractions * (b - a) for a, b in zip(path, np.vstack((path[1:], path[-1:])), strict=True)]
    dense = np.vstack(pieces)
    brute = np.array([np.linalg.norm(dense - point, axis=1).min() for point in points])
    assert np.all(found.distance <= brute + 1e-12)
    assert np.all(found.distance >= brute - 1e-3)
    # The place that far along the path is that far from the point.
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    places = np.column_stack([np.interp(found.along, travelled, path[:, axis]) for axis in (0, 1)])
    assert np.allclose(np.linalg.norm(points - places, axis=1), found.distance, atol=1e-9)
    assert found.length == pytest.approx(travelled[-1])


def test_deviation_is_the_distance_from_the_reference() -> None:
    beside = ALONG + np.column_stack((np.zeros(101), np.where(np.arange(101) < 50, 0.002, 0.006)))
    inside = np.arange(101) < 50
    numbers = measured(trial_of(beside, inside=inside))
    assert numbers["deviation_max_m"] == pytest.approx(0.006)
    assert numbers["deviation_mean_m"] == pytest.approx((50 * 0.002 + 51 * 0.006) / 101)
    assert numbers["deviation_rms_m"] == pytest.approx(math.sqrt((50 * 0.002**2 + 51 * 0.006**2) / 101))
    assert numbers["deviation_inside_max_m"] == pytest.approx(0.002)
    assert numbers["deviation_outside_mean_m"] == pytest.approx(0.006)
    assert measured(trial_of(beside))["deviation_outside_mean_m"] is None  # all of it is outside


def test_of_points_to_be_held_only_the_time_counts_in_which_they_were() -> None:
    goal = np.full((101, 2), np.nan)
    goal[40:60], goal[80:] = (0.0, 0.45), (0.03, 0.45)
    places = np.where(np.isfinite(goal), goal + (0.0, 0.003), (9.0, 9.0))
    places[80:] += (0.0, 0.004)
    numbers = measured(
        trial_of(places, goal=goal), "hold", target=None, reference=np.array([[0.0, 0.45], [0.03, 0.45]])
    )
    assert numbers["deviation_max_m"] == pytest.approx(0.007)
    assert numbers["time_on_target_s"] == pytest.approx(0.20)
    assert numbers["time_on_target_fraction"] == pytest.approx(20 / 41)
    assert numbers["goals_reached_fraction"] == 0.5
    assert not numbers["success"]
    assert numbers["smoothness_sparc"] is None


# -------------------------------------------------------------------------------------------- force, speed and time
def test_force_speed_and_work_of_a_straight_motion_under_a_constant_force() -> None:
    force = np.tile((3.0, 4.0), (101, 1))
    numbers = measured(trial_of(ALONG, force_commanded=force, force_measured=2 * force))
    assert numbers["force_commanded_mean_N"] == pytest.approx(5.0)
    assert numbers["force_measured_max_N"] == pytest.approx(10.0)
    assert numbers["energy_delivered_J"] == pytest.approx(3.0 * 0.2)  # across the motion there is no work
    assert numbers["force_change_max_N_s"] == pytest.approx(5.0 / 0.01)  # it was zero before the trial
    assert numbers["speed_mean_m_s"] == pytest.approx(0.2)
    assert numbers["duration_s"] == pytest.approx(1.0)
    assert numbers["path_length_m"] == pytest.approx(0.2)
    assert numbers["path_length_ratio"] == pytest.approx(1.0)


def test_path_ratio_of_two_sides_of_a_triangle() -> None:
    corner = np.vstack((np.linspace((0.0, 0.45), (0.03, 0.45), 50), np.linspace((0.03, 0.45), (0.03, 0.49), 50)))
    numbers = measured(trial_of(corner))
    assert numbers["path_length_ratio"] == pytest.approx(7 / 5)


def test_target_is_reached_when_the_hand_first_comes_within_it() -> None:
    numbers = measured(trial_of(ALONG))
    assert numbers["time_to_target_s"] == pytest.approx(0.98)  # 0.196 m of 0.200: 4 mm away
    assert numbers["time_on_target_s"] == pytest.approx(0.03)
    assert numbers["final_distance_m"] == pytest.approx(0.0)
    assert numbers["success"]
    assert not measured(trial_of(ALONG, ended="late"))["success"]
    short = measured(trial_of(ALONG[:90]))
    assert short["time_to_target_s"] is None
    assert not short["success"]


def test_stretch_without_a_target_is_done_on_any_place_of_the_line() -> None:
    line = np.array([[0.2, 0.40], [0.2, 0.52]])
    numbers = measured(trial_of(ALONG), "stretch", target=None, reference=line)
    assert numbers["success"]
    assert numbers["time_to_target_s"] == pytest.approx(0.98)


def test_a_part_of_a_path_that_is_left_out_shows_though_the_hand_stays_near() -> None:
    there_and_back = np.vstack((ALONG, ALONG[::-1] + (0.0, 0.02)))
    half = np.vstack((ALONG, ALONG[::-1]))  # twice along the first side
    whole = measured(trial_of(there_and_back), "follow", target=None, reference=there_and_back)
    left_out = measured(trial_of(half, intended=there_and_back), "follow", target=None, reference=there_and_back)
    assert whole["reference_covered_fraction"] == 1.0
    assert left_out["deviation_max_m"] == pytest.approx(0.02, abs=1e-3)  # from where it was due, not the nearest side
    assert left_out["reference_covered_fraction"] == pytest.approx((0.2 + 2 * 0.005) / 0.42, abs=0.02)
    assert left_out["from_intended_max_m"] == pytest.approx(0.02)


# ----------------------------------------------------------------------------------------------------------- claims
def test_time_from_entry_to_zero_force_is_that_of_the_slowest_stay() -> None:
    inside, force = np.zeros(101, dtype=bool), np.zeros((101, 2))
    inside[10:30], inside[50:80] = True, True
    force[5:14], force[45:62] = (2.0, 0.0), (0.0, -1.0)
    assert time_to_zero_force(trial_of(STILL, inside=inside, force_commanded=force)) == pytest.approx(0.12)
    force[45:90] = (0.0, 1e-300)  # never let go: the whole stay counts
    assert time_to_zero_force(trial_of(STILL, inside=inside, force_commanded=force)) == pytest.approx(0.30)
    assert time_to_zero_force(trial_of(STILL, force_commanded=force)) is None


def test_force_that_is_wanted_or_grows_inside_is_seen() -> None:
    inside, force = np.arange(101) >= 50, np.zeros((101, 2))
    force[40:50] = (7.0, 0.0)
    force[50:53] = [(6.0, 0.0), (3.0, 0.0), (4.0, 0.0)]
    wanted = np.zeros((101, 2))
    wanted[:50], wanted[70] = 9.0, (0.3, 0.4)
    numbers = measured(trial_of(STILL, inside=inside, force_commanded=force, force_desired=wanted))
    assert numbers["force_growth_inside_max_N"] == pytest.approx(1.0)
    assert numbers["force_desired_inside_max_N"] == pytest.approx(0.5)


def test_resistance_is_told_apart_near_the_target_and_before_it() -> None:
    hand = np.delete(ALONG, 75, axis=0)  # without the place where the quarter begins
    against = -np.column_stack((np.where(hand[:, 0] > 0.15, 9.0, 2.0), np.full(100, 50.0)))
    numbers = measured(trial_of(hand, force_commanded=against), "resist")
    assert numbers["force_along_reference_last_quarter_mean_N"] == pytest.approx(-9.0)
    assert numbers["force_along_reference_before_mean_N"] == pytest.approx(-2.0)
    assert numbers["force_along_reference_outside_max_N"] == pytest.approx(-2.0)
    backwards = measured(trial_of(hand, force_commanded=against), "resist", reference=LINE[::-1])
    assert backwards["force_along_reference_outside_min_N"] == pytest.approx(2.0)


def test_releases_are_counted_once_each() -> None:
    names = [Status.OK] * 20 + [Status.RELEASING] * 5 + [Status.RELEASED] * 5 + [Status.BACKUP] * 10 + [Status.RELEASED]
    status = np.array([name.value for name in names + [Status.OK] * (101 - len(names))])
    numbers = measured(trial_of(STILL, status=status))
    assert numbers["releases"] == 2
    assert sum(numbers["status_fraction"].values()) == pytest.approx(1.0)
    assert numbers["status_fraction"]["backup"] == pytest.approx(10 / 101)
    assert measured(trial_of(STILL[20:], status=status[20:]))["releases"] == 2  # the first of them from the first tick


# ---------------------------------------------------------------------------------------------------------- numbers
@pytest.mark.parametrize("mode", MODES)
def test_numbers_are_strict_json_and_their_keys_the_same_for_every_trial(mode: Mode) -> None:
    outcome = made_outcome(mode)
    every = [of for law in outcome.measures.values() for of in law]
    assert len({tuple(of) for of in every}) == 1
    json.dumps([every, [law_summary(of) for of in outcome.measures.values()]], allow_nan=False)


def test_summary_is_mean_and_worst_and_a_time_that_was_never_reached_is_the_worst() -> None:
    numbers: list[dict[str, Any]] = [
        {
            "success": success,
            "a_N": a,
            "smoothness_sparc": sparc,
            "time_to_target_s": time,
            "status_fraction": {status: 1.0},
        }
        for success, a, sparc, time, status in ((True, 1.0, -2.0, 3.0, "ok"), (False, 4.0, -5.0, None, "backup"))
    ]
    summary = law_summary(numbers)
    assert summary["success_rate"] == 0.5
    assert summary["mean"] == {
        "a_N": 2.5, "smoothness_sparc": -3.5, "time_to_target_s": 3.0, "status_fraction": {"ok": 0.5, "backup": 0.5},
    }  # fmt: skip
    assert summary["worst"] == {"a_N": 4.0, "smoothness_sparc": -5.0, "time_to_target_s": None}
