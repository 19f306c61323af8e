"""Every installed solver on the recorded QPs, warm: `pytest bench/test_bench_corpus.py --benchmark-only`.

`--benchmark-group-by=param:solver` shows one solver on all families, `param:sequence` all solvers on one.
"""

from __future__ import annotations

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from bench.corpus import along, quality, read, representatives
from bench.solvers.entrants import entrants

ENTRANTS = {entrant.name: entrant for entrant in entrants() if entrant.kind == "qp"}


@pytest.mark.filterwarnings("ignore")  # solvers warn of what they are given
@pytest.mark.benchmark(max_time=0.2, min_rounds=20)
@pytest.mark.parametrize("sequence", representatives())
@pytest.mark.parametrize("solver", ENTRANTS)
def test_solve(benchmark: BenchmarkFixture, solver: str, sequence: str) -> None:
    benchmark(along(ENTRANTS[solver], read(sequence)))
    if benchmark.enabled:
        benchmark.extra_info.update(quality(ENTRANTS[solver], read(sequence))._asdict())
