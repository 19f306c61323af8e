"""How benchmarks are grouped: by a parameter also where not every benchmark has one of that name."""

from __future__ import annotations

from typing import Any

import pytest
from pytest_benchmark import plugin

__all__ = ["pytest_benchmark_group_stats"]

BY_PARAMETER = "param:"


@pytest.hookimpl(tryfirst=True)
def pytest_benchmark_group_stats(
    config: pytest.Config, benchmarks: list[dict[str, Any]], group_by: str
) -> list[tuple[str | None, list[dict[str, Any]]]]:
    """Those of pytest-benchmark, which raises KeyError where one lacks the parameter: such go by their function."""
    wanted = {each.removeprefix(BY_PARAMETER) for each in group_by.split(",") if each.startswith(BY_PARAMETER)}
    able = [bench for bench in benchmarks if wanted <= set(bench["params"] or {})]
    others = [bench for bench in benchmarks if not wanted <= set(bench["params"] or {})]
    groups = plugin.pytest_benchmark_group_stats
    return [*groups(config, able, group_by), *groups(config, others, "func")]
