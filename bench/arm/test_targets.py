"""The yardstick itself: targets are what they are said to be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.arm.baselines import nearest_point, position_ik
from bench.arm.targets import (
    figure_eight,
    handle_tilt,
    holds,
    nearest_distance,
    random_path,
    reachable,
    unreachable,
)
from rehab_opt import SerialChain, human_arm

TILT = math.radians(2)


@pytest.fixture(params=["regular", "restricted"])
def arm(request: pytest.FixtureRequest) -> SerialChain:
    return human_arm(range_of_motion=request.param)


def test_reachable_targets_are_reached(arm: SerialChain) -> None:
    random, nearest = np.random.default_rng(0), nearest_point(arm, tilt=TILT)
    for target in reachable(arm, 10, tilt=TILT):
        assert nearest_distance(arm, nearest, target, 5, random) <= 1e-5


def test_unreachable_targets_are_outside(arm: SerialChain) -> None:
    random, nearest = np.random.default_rng(5), nearest_point(arm, tilt=TILT)
    for target in unreachable(arm, 4, tilt=TILT):
        assert 0.0099 <= nearest_distance(arm, nearest, target, 20, random) <= 0.3


def test_paths_are_smooth_and_reachable(arm: SerialChain) -> None:
    random, nearest = np.random.default_rng(0), nearest_point(arm, tilt=TILT)
    for path in (figure_eight(arm, 400, tilt=TILT, cells=9), random_path(arm, 100, tilt=TILT, seed=0)):
        steps = np.diff(path, axis=0)
        assert np.linalg.norm(steps, axis=1).max() <= 0.01
        assert np.linalg.norm(np.diff(steps, axis=0), axis=1).max() <= 2e-3
        for point in path[::20]:
            assert nearest_distance(arm, nearest, point, 5, random) <= 1e-5


def test_ipopt_keeps_to_what_counts_as_solved(arm: SerialChain) -> None:
    single = position_ik(arm, tilt=TILT, solver="ipopt")
    for target in reachable(arm, 10, tilt=TILT):
        answer = single((arm.lower + arm.upper) / 2, target)
        assert answer.found
        assert np.linalg.norm(arm.pose(answer.q)[:3, 3] - target) <= 1e-6
        assert holds(arm, answer.q, TILT + 1e-9)


def test_handle_tilt_is_accurate_near_zero() -> None:
    arm = human_arm()
    q = (arm.lower + arm.upper) / 2
    cosine = float(arm.pose(q)[2, 0])
    assert handle_tilt(arm, q) == pytest.approx(math.acos(cosine), abs=1e-9)
