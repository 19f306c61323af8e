"""Numbers of a run, against cases whose answer is known."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.session.mirror.metrics import led_metrics
from rehab_opt.session.outcome import (
    joint_metrics,
)
from rehab_opt.session.trace import Trace
from rehab_opt.session.upper_limb.drive import bounds_of_drive, driven, hand_and_tilt
from rehab_opt.session.upper_limb.problem import SmoothingSection

ARM = human_arm(range_of_motion="restricted")


def test_margin_is_that_of_the_nearest_free_joint_and_negative_outside() -> None:
    middle = (ARM.lower + ARM.upper) / 2
    q = np.array([middle, middle])
    q[1, 4] = ARM.upper[4] + np.deg2rad(1.5)
    numbers = joint_metrics(ARM, q, rate=10.0)
    assert numbers["joint_limit_margin_joint"] == "forearm_extension"
    assert numbers["joint_limit_margin_min_deg"] == pytest.approx(-1.5)
    assert numbers["joint_speed_max_joint"] == "forearm_extension"
    assert numbers["joint_speed_max_deg_s"] == pytest.approx(165.0)
    assert numbers["joint_speed_max_fraction_of_limit"] == pytest.approx(np.deg2rad(165.0) / 3.0)


def test_unlimited_and_locked_joints_give_strict_json() -> None:
    free = ARM.with_limits(lower=np.full(8, -np.inf), upper=np.full(8, np.inf))
    locked = ARM.with_limits(lower=ARM.lower, upper=ARM.lower)
    for arm in (free, locked):
        numbers = joint_metrics(arm, np.array([ARM.lower, ARM.lower]), rate=10.0)
        assert json.loads(json.dumps(numbers, allow_nan=False))["joint_limit_margin_min_deg"] is None


def test_arm_slower_to_accelerate_than_the_file_says_is_driven_at_its_own_acceleration() -> None:
    slow = ARM.with_limits(acceleration=np.deg2rad(100.0))
    q = np.tile((ARM.lower + ARM.upper) / 2, (200, 1))
    q[50:, 3] = ARM.upper[3]
    bounds = bounds_of_drive(slow, SmoothingSection())
    drive = dict(driven(slow, q, np.arange(200) / 100.0, np.zeros((200, 3)), bounds, handle_tilt=3.0))
    np.testing.assert_allclose(np.rad2deg(bounds["acceleration"]), 100.0)
    acceleration = np.abs(np.diff(drive["_drive_joint"][:, 3], 2)).max() * 1000.0**2
    assert np.rad2deg(acceleration) <= 100.0 * (1 + 1e-6)


def test_driven_joints_keep_limits_and_speed_and_arrive_late() -> None:
    q = np.tile((ARM.lower + ARM.upper) / 2, (200, 1))
    q[50:, 3] = ARM.upper[3]  # a step up to the limit
    bounds = bounds_of_drive(ARM, SmoothingSection(speed_deg_s=60.0))
    drive = dict(driven(ARM, q, np.arange(200) / 100.0, np.zeros((200, 3)), bounds, handle_tilt=3.0))
    smooth = drive["_drive_joint"]
    assert (smooth >= ARM.lower).all()
    assert (smooth <= ARM.upper).all()
    assert np.rad2deg(np.abs(np.diff(smooth, axis=0)).max() / 1e-3) <= 60.0 + 1e-6
    np.testing.assert_allclose(smooth[-1], q[-1], atol=1e-9)
    np.testing.assert_allclose(drive["drive"], q, atol=1e-4)
    away = np.degrees(ARM.upper[3] - q[0, 3])
    assert drive["drive_t_s"][-1] - 1.99 >= away / 60.0 - 0.01


@pytest.mark.parametrize("seed", range(2))
def test_a_change_of_posture_from_sample_to_sample_leads_hand_and_handle_off_by_nothing(seed: int) -> None:
    arm = ARM.with_limits(lower=ARM.lower - 0.6, upper=ARM.upper + 0.6)
    here = (arm.lower + arm.upper) / 2
    there, turns = here.copy(), np.random.default_rng(seed).standard_normal(arm.n)
    hand = arm.pose(here)[:3, 3]
    for _ in range(250):  # the hand stays
        rows = arm.jacobian(there)[:3]
        inverse = np.linalg.pinv(rows)
        turns = turns - inverse @ (rows @ turns)
        there = there + 2e-3 * turns / np.abs(turns).max() + inverse @ (hand - arm.pose(there)[:3, 3])
    tilts = hand_and_tilt(arm, np.array([here, there]))[1]
    middle = arm.pose((here + there) / 2)[:3, 3]
    assert np.linalg.norm(middle - hand) > 1e-3  # else this says nothing
    q = np.vstack([np.tile(here, (50, 1)), np.tile(there, (50, 1))])
    limit = float(tilts.max())
    bounds = bounds_of_drive(arm, SmoothingSection())
    drive = dict(driven(arm, q, np.arange(100) / 100.0, np.tile(hand, (100, 1)), bounds, handle_tilt=limit))
    assert np.linalg.norm(drive["_drive_hand"] - hand, axis=1).max() < 5e-4
    assert drive["drive_handle_tilt_rad"].max() < limit + math.radians(0.02)


def test_where_the_last_tick_leads_counts_in_a_laws_metrics() -> None:
    robot, rate, start = ur5(), 100.0, np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    pose, still, turning = robot.pose(start), np.zeros(6), np.eye(6)[0]
    zeros, tool = np.zeros(2), np.array([pose, pose])
    common: dict[str, Any] = {"deviation_m": zeros, "lag_s": zeros, "manipulability": zeros, "_tool": tool,
                              "t_s": np.array([0.0, 0.01])}  # fmt: skip
    texts = dict.fromkeys(("status", "relaxed", "_reason"), np.array([], dtype=str))
    led = Trace(
        {**common, **texts, "joint": [start, start], "command": [still, turning], "_seconds": zeros, "_complete": True,
         "turn_rad": zeros, "pace": zeros, "_counts": {}}
    )  # fmt: skip
    bounds: Any = SimpleNamespace(chain=robot, max_manipulability=1.0, floor=0.0)
    cause = np.zeros(2, dtype=int)
    numbers = led_metrics(led, Trace(common), bounds, np.array([pose]), cause=cause, rate=rate)
    assert numbers["joint_speed_max_deg_s"] == pytest.approx(math.degrees(1.0))
    radius = math.hypot(*pose[:2, 3])  # the base turns about its own axis
    assert numbers["tool_speed_max_m_s"] == pytest.approx(radius, rel=1e-4)
