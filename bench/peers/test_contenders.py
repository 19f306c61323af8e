"""Every contender computes with the same arm and follows the path: what makes the comparison fair."""

from __future__ import annotations

import numpy as np
import pytest

from bench.peers.contender import verify_kinematics
from bench.peers.path import START, circle
from bench.peers.pose_tracking import DT, entered, rows
from bench.peers.rounds import alternate
from rehab_opt import ur5

for package in ("placo", "pink", "mink"):
    pytest.importorskip(package, reason="the peers are an optional extra")


@pytest.mark.parametrize("limit", [np.pi, 0.35])
def test_contenders_have_our_kinematics_and_follow_the_path(limit: float) -> None:
    chain = ur5(velocity=limit)
    contenders = entered(chain)
    for contender in contenders:
        verify_kinematics(contender, chain)
    path = circle(chain, 1000, dt=DT)
    table = rows(alternate(contenders, path, START, rounds=2, ticks=50), chain, path)
    for row in table:
        assert row.over <= 0.02, row  # proxqp's default tolerance is the loosest
        if limit > 1:
            assert row.error <= 0.05, row
            assert row.saturated == 0, row
        else:
            assert row.saturated >= 0.5, row


def test_another_arm_is_refused() -> None:
    tool = np.eye(4)
    tool[2, 3] = 1e-6
    contender = entered(ur5(tool=tool))[0]
    with pytest.raises(AssertionError, match="hand pose differs"):
        verify_kinematics(contender, ur5())
