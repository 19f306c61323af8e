"""What counts as slower."""

from __future__ import annotations

import math

from bench.compare import Change, changes

BEFORE = {"pose/free": {"qrqp-fused": 0.10, "osqp-kept": 2.0}}


def test_a_ratio_worse_than_the_factor_fails_and_a_better_one_does_not() -> None:
    now = {"pose/free": {"qrqp-fused": 0.16, "osqp-kept": 2.9}}
    assert [each.worse(1.5) for each in changes(BEFORE, now)] == [True, False]
    assert [each.worse(1.7) for each in changes(BEFORE, now)] == [False, False]


def test_what_is_no_longer_measured_fails_and_what_is_new_does_not() -> None:
    now = {"pose/free": {"qrqp-fused": 0.10}, "mirror/new": {"qrqp-fused": 9.0}}
    found = {(each.sequence, each.solver): each.worse(1.5) for each in changes(BEFORE, now)}
    assert found == {
        ("pose/free", "qrqp-fused"): False,
        ("pose/free", "osqp-kept"): True,
        ("mirror/new", "qrqp-fused"): False,
    }


def test_a_time_that_is_no_number_fails() -> None:
    assert Change("pose/free", "qrqp-fused", 0.1, math.nan).worse(1.5)
