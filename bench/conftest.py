"""How benchmarks are grouped, by a parameter also where not every one has it, and how good the solvers' answers are."""

from __future__ import annotations

from typing import Any

import pytest
from pytest_benchmark import plugin

__all__ = ["pytest_benchmark_group_stats", "pytest_terminal_summary"]

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


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Below the table of times: certified fraction and residual of each solver, since one that fails is often fast."""
    judged = [bench for bench in config._benchmarksession.benchmarks if "certified" in bench.extra_info]  # type: ignore[attr-defined]
    if not judged:
        return
    terminalreporter.section("answers that the certificate accepts, largest residual")
    width = max(len(bench.name) for bench in judged)
    for bench in sorted(judged, key=lambda each: float(each.extra_info["certified"])):
        certified, residual = bench.extra_info["certified"], bench.extra_info["residual"]
        terminalreporter.write_line(f"{bench.name:{width}}  {100 * certified:6.1f} %  {residual:.1e}")
