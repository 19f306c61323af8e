"""The tick's QP given to kept-alive solvers and to a fresh qpsolvers call: what keeping the workspace is worth."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import qpsolvers
from pytest_benchmark.fixture import BenchmarkFixture
from scipy import sparse

from bench.corpus import Quality
from bench.long_run import DT, round_trip
from bench.peers.path import START
from bench.solvers.dense_qp import Certificate
from rehab_opt import PoseTracker, ur5
from rehab_opt.optim.backends import Answer, answer_from, backend
from rehab_opt.optim.rows import Instance

TOLERANCE = 1e-8
"""Largest certified residual: `PoseTracker`'s."""


def recorded(limit: float, ticks: int = 200) -> list[Instance]:
    """QPs of successive ticks on the circle."""
    tracker = PoseTracker(ur5(velocity=limit), dt=DT, compile=False)
    path, q = round_trip(tracker.chain), START.copy()
    instances = []
    for pose, twist in itertools.islice(zip(path.poses, path.twists, strict=True), 300 + ticks):
        instances.append(tracker.instance(q, pose, twist))
        q = q + DT * tracker.step(q, pose, twist).value
    return instances[-ticks:]


@pytest.fixture(params=[np.pi, 0.35], ids=["free", "limited"], scope="module")
def instances(request: pytest.FixtureRequest) -> list[Instance]:
    return recorded(request.param)


def judged(instances: list[Instance], solve: Callable[[Instance], Answer]) -> dict[str, float]:
    """Certified fraction and largest residual of the answers."""
    certificate = Certificate(instances[0].g.size, instances[0].rows_lower.size)
    return Quality.of((certificate.residual(qp, solve(qp)) for qp in instances), TOLERANCE)._asdict()


def forth_and_back(instances: list[Instance]) -> Iterator[Instance]:
    """Without a jump at the end, which would spoil the warm start."""
    return itertools.cycle([*instances, *reversed(instances)])


@pytest.mark.parametrize("name", ["proxqp", "osqp", "daqp", "quadprog"])
def test_backend(benchmark: BenchmarkFixture, instances: list[Instance], name: str) -> None:
    if name not in ("proxqp", "osqp", *qpsolvers.available_solvers):
        pytest.skip(f"{name} is not installed")
    solver = backend(name, instances[0].g.size, instances[0].rows_lower.size)
    stream = forth_and_back(instances)
    answer = benchmark(lambda: solver.solve(next(stream)))
    assert np.isfinite(answer.x).all()
    benchmark.extra_info.update(judged(instances, solver.solve))


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # qpsolvers calls osqp the old way
@pytest.mark.parametrize("name", ["proxqp", "osqp"])
def test_fresh_qpsolvers_call(benchmark: BenchmarkFixture, instances: list[Instance], name: str) -> None:
    stream = forth_and_back(instances)
    options: dict[str, Any] = {"eps_abs": 1e-10, "eps_rel": 0.0}

    def fresh(qp: Instance) -> qpsolvers.Solution:
        hessian = sparse.csc_matrix(qp.H) if name == "osqp" else qp.H
        problem = qpsolvers.Problem(hessian, qp.g, None, None, None, None, qp.lower, qp.upper)
        return qpsolvers.solve_problem(problem, solver=name, **options)

    assert benchmark(lambda: fresh(next(stream))).x is not None
    benchmark.extra_info.update(judged(instances, lambda qp: answer_from(qp, fresh(qp))))
