"""Poses and Jacobians as a caller gets them: checked, copied arrays."""

from __future__ import annotations

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rehab_opt import SerialChain, human_arm, ur5


@pytest.fixture(params=["ur5", "human_arm"])
def chain(request: pytest.FixtureRequest) -> SerialChain:
    return ur5() if request.param == "ur5" else human_arm()


@pytest.mark.parametrize("quantity", ["pose", "jacobian", "manipulability", "manipulability_gradient"])
def test_serial_chain(benchmark: BenchmarkFixture, chain: SerialChain, quantity: str) -> None:
    q = (0.6 * chain.lower + 0.4 * chain.upper).copy()
    benchmark(getattr(chain, quantity), q)
