"""The command that the README names reads well: `pytest bench --benchmark-only --benchmark-group-by=param:solver`."""

from __future__ import annotations

from typing import Any

import pytest

from bench.conftest import pytest_benchmark_group_stats


def bench(name: str, **params: str) -> dict[str, Any]:
    return {"name": name, "fullname": f"bench/x.py::{name}", "group": None, "param": None, "params": params or None}


BENCHES = [
    bench("test_solve[daqp-mirror]", solver="daqp", sequence="mirror"),
    bench("test_solve[fallback-ardis]", solver="fallback", sequence="ardis"),
    bench("test_solve[fallback-mirror]", solver="fallback", sequence="mirror"),
    bench("test_tracker[daqp]", solver="daqp"),
    bench("test_chain[pose]", quantity="pose"),
    bench("test_plain"),
]


@pytest.mark.parametrize(
    ("group_by", "expected"),
    [
        ("param:solver", {"solver=daqp": 2, "solver=fallback": 2, "test_chain": 1, "test_plain": 1}),
        (
            "param:sequence",
            {"sequence=ardis": 1, "sequence=mirror": 2, "test_tracker": 1, "test_chain": 1, "test_plain": 1},
        ),
        ("func", {"test_solve": 3, "test_tracker": 1, "test_chain": 1, "test_plain": 1}),
    ],
)
def test_every_benchmark_has_a_group_whatever_its_parameters(
    pytestconfig: pytest.Config, group_by: str, expected: dict[str, int]
) -> None:
    groups = pytest_benchmark_group_stats(pytestconfig, list(BENCHES), group_by)
    assert {name: len(each) for name, each in groups} == expected
