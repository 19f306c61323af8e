"""Limits of a chair with its arm, and where a velocity leads them, against plain numpy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from rehab_opt import Limit, ardis
from rehab_opt.control.chair_limits import ChairLimits
from rehab_opt.control.limit import all_limits
from rehab_opt.kinematics import DRIVES, DriveName

DT = 0.01


def chair_limits(drive: DriveName, *own: Limit) -> ChairLimits:
    robot = ardis(keep_out=())
    posture = all_limits(own, robot.chain, DT, 1.0)
    return ChairLimits(robot, robot.drive(drive), max_obstacles=0, dt=DT, recovery_speed=0.1, own=posture)


@pytest.mark.parametrize("drive", DRIVES)
def test_a_joint_that_stands_does_not_make_braking_longer(drive: DriveName) -> None:
    slowest = 0.3 if drive == "fixed" else 0.8  # [s] the elbow, or the chair forward
    assert chair_limits(drive).braking.time == pytest.approx(1.1 * slowest)


def test_a_steady_velocity_leads_the_chair_where_its_ticks_do() -> None:
    """Each goes straight along its beginning."""
    rng = np.random.default_rng(0)
    for seconds in (DT, 0.3, 1.0):
        q, u = rng.uniform(-2, 2, 7), rng.uniform(-1, 1, 7)
        there = q.copy()
        for _ in range(round(seconds / DT)):
            cos, sin = np.cos(there[2]), np.sin(there[2])
            there = there + DT * np.array([cos * u[0] - sin * u[1], sin * u[0] + cos * u[1], *u[2:]])
        led = np.array(ca.DM(chair_limits("mecanum").led(ca.SX(q), ca.SX(u), seconds))).ravel()
        np.testing.assert_allclose(led, there, rtol=0, atol=1e-4 * seconds)
