"""What a linear limit says of a step, against plain numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from rehab_opt.control.linear_limit import LinearLimit, SymmetricLimit


@pytest.mark.parametrize("kind", [LinearLimit, SymmetricLimit])
@pytest.mark.parametrize("from_rest", [True, False])
def test_the_largest_part_of_a_step_ends_at_the_first_row_in_its_way(kind: type[LinearLimit], from_rest: bool) -> None:
    rng, u, shortened = np.random.default_rng(0), ca.SX.sym("u", 3), 0
    for _ in range(200):
        matrix, way = rng.normal(size=(5, 3)), rng.normal(size=3)
        begin = np.zeros(3) if from_rest else rng.normal(size=3)
        limit = kind(ca.SX(matrix), ca.SX(np.abs(matrix @ begin) + rng.uniform(0, 2, 5)))
        part = float(limit.max_step_size(ca.SX(way), None if from_rest else ca.SX(begin)))
        excess = ca.Function("excess", [u], [ca.mmax(limit.excess(u))])
        assert float(excess(begin + part * way)) <= 1e-12
        assert part == 1 or float(excess(begin + (part + 1e-6) * way)) > 0
        shortened += part < 1
    assert 20 < shortened < 200


def test_a_limit_of_some_joints_is_none_of_the_others() -> None:
    limit = LinearLimit.of_joints(1, 4, ca.SX([[1.0, 2.0]]), ca.SX(3.0))
    assert limit.matrix.shape == (1, 4)
    assert limit.matrix.nnz() == 2
    assert float(limit.excess(ca.SX([9.0, 1.0, 2.0, 9.0]))) == 2.0
    assert float(limit.beyond(ca.SX([0.0, 1.0, 0.0, 0.0])).upper) == 4.0


def test_beyond_the_limit_a_step_goes_back_and_no_further_than_the_slack() -> None:
    limit, there = LinearLimit(ca.SX([[1.0]]), ca.SX(1.0)), ca.SX(1.5)
    assert float(limit.max_step_size(ca.SX(-2.0), there)) == 1.0
    assert float(limit.max_step_size(ca.SX(1.0), there)) == 0.0
    assert float(limit.max_step_size(ca.SX(1.0), there, 0.25)) == 0.25
