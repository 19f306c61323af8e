"""Every contender computes with the same arm and follows the path: what makes the comparison fair."""

from __future__ import annotations

import numpy as np
import pytest

from bench.peers.contender import Contender, verify_kinematics
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
    class Longer(Contender):
        name = "longer"

        def pose(self, q):  # type: ignore[no-untyped-def]
            return ur5(tool=np.block([[np.eye(3), [[0], [0], [1e-6]]], [0, 0, 0, 1]])).pose(q)

        def target(self, path, k): ...  # type: ignore[no-untyped-def, empty-body]

        def tick(self, q, target): ...  # type: ignore[no-untyped-def, empty-body]

    with pytest.raises(AssertionError, match="hand pose differs"):
        verify_kinematics(Longer(), ur5())
