"""Every solver answers the same, says when it cannot, and is well again afterwards."""

import time
import warnings

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.optim.backends import (
    Answer,
    DaqpBackend,
    OsqpBackend,
    ProxqpBackend,
    QpsolversBackend,
    backend,
    to_qpsolvers,
)
from rehab_opt.optim.certificate import certificate_function, is_certified
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import BufferedFunction
from tests.optim.random_qps import Array, random_qp, seeds, solved
from tests.refusals import refuses

SOLVERS = sorted({*qpsolvers.available_solvers, "proxqp", "osqp"})
TOLERANCE = 1e-6
SECONDS = 2.0
N, M = 4, 3
CERTIFICATES = {
    (n, m): BufferedFunction(certificate_function(n, m)) for n, m in [(N, M), (N, 0), (1, 0), (1, 2), (6, 1)]
}


def certified(qp: Instance, answer: Answer) -> tuple[bool, Array]:
    """Whether the answer passes, and x as it is used."""
    certify = CERTIFICATES[qp.g.size, qp.rows_lower.size]
    for target, value in zip(certify.inputs, [*qp, 1.0, *answer[:3]], strict=True):
        target[...] = np.reshape(value, target.shape)
    certify()
    return is_certified(float(certify.outputs[1][0]), TOLERANCE), certify.outputs[0].copy()


def changed(**numbers: object) -> Instance:
    """A good problem with other numbers in places."""
    return random_qp(7, N, M, unbounded=False)._replace(**numbers)


TWICE = np.vstack([np.eye(N)[0], np.eye(N)[0], np.eye(N)[1]])
FAULTS = {
    "NaN in the Hessian": changed(H=np.where(np.eye(N) > 0, np.nan, 0.0)),
    "NaN in the cost": changed(g=np.array([0.0, np.nan, 0.0, 0.0])),
    "NaN in a row": changed(A=np.full((M, N), np.nan)),
    "NaN in a bound": changed(lower=np.array([0.0, np.nan, 0.0, 0.0])),
    "NaN in a row's bound": changed(rows_upper=np.array([0.0, np.nan, 0.0])),
    "infinite cost": changed(g=np.full(N, np.inf)),
    "crossed bounds": changed(lower=np.ones(N), upper=-np.ones(N)),
    "crossed rows": changed(rows_lower=np.ones(M), rows_upper=-np.ones(M)),
    "rows that contradict each other": changed(
        A=TWICE, rows_lower=np.array([0.5, -0.9, -1.0]), rows_upper=np.array([0.9, -0.5, 1.0])
    ),
    "equalities that contradict each other": changed(
        A=TWICE, rows_lower=np.array([0.5, 0.6, 0.0]), rows_upper=np.array([0.5, 0.6, 0.0])
    ),
    "rows out of reach of the bounds": changed(
        A=TWICE, rows_lower=np.full(M, 50.0), rows_upper=np.full(M, 60.0), lower=-np.ones(N), upper=np.ones(N)
    ),
    "a cost without a minimum": changed(
        H=np.zeros((N, N)), A=np.zeros((M, N)), rows_lower=-np.ones(M), rows_upper=np.ones(M),
        lower=np.full(N, -np.inf), upper=np.full(N, np.inf),
    ),
    "a cost of 1e300": changed(g=np.full(N, 1e300)),
    "rows of 1e200": changed(rows_lower=np.full(M, 1e200), rows_upper=np.full(M, 1e201)),
    "bounds at infinity": changed(lower=np.full(N, np.inf), upper=np.full(N, np.inf)),
    "a Hessian of 1e300": changed(H=1e300 * np.eye(N)),
    "rows of slope 1e300": changed(A=np.full((M, N), 1e300)),
    "a concave cost": changed(H=-np.eye(N)),
}  # fmt: skip
POSSIBLE = {"a Hessian of 1e300", "a concave cost", "a cost of 1e300"}
"""A stationary point of these exists and may be found and certified."""


# ----------------------------------------------------------------------------------------------------- agreement
@pytest.mark.parametrize("solver", SOLVERS)
@settings(max_examples=25)
@given(seeds, st.sampled_from(list(CERTIFICATES)))
def test_what_is_certified_is_the_solution_whoever_found_it(solver: str, seed: int, size: tuple[int, int]) -> None:
    qp = random_qp(seed, *size)
    passed, x = certified(qp, backend(solver, *size).solve(qp))
    if passed:
        np.testing.assert_allclose(x, solved(qp).x, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("seed", range(1))
def test_tick_after_tick_of_a_drifting_problem_is_solved(solver: str, seed: int) -> None:
    start, drift = random_qp(seed, N, M, unbounded=False), random_qp(seed + 5, N, M)
    kept = backend(solver, N, M)
    for step in np.linspace(0, 0.5, 40):
        qp = start._replace(g=start.g + step * drift.g, H=start.H + step * drift.H)
        passed, x = certified(qp, kept.solve(qp))
        assert passed
        np.testing.assert_allclose(x, solved(qp).x, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_problem_unlike_the_last_is_solved_too(solver: str) -> None:
    kept = backend(solver, N, M)
    problems = [random_qp(seed, N, M) for seed in range(100)]
    assert [seed for seed, qp in enumerate(problems) if not certified(qp, kept.solve(qp))[0]] == []


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_answer_is_not_overwritten_by_the_next(solver: str) -> None:
    kept = backend(solver, N, M)
    first = kept.solve(random_qp(1, N, M))
    copies = [part.copy() for part in first[:3]]
    kept.solve(random_qp(2, N, M))
    for part, copy in zip(first[:3], copies, strict=True):
        np.testing.assert_array_equal(part, copy)


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_problem_is_not_changed_by_solving_it(solver: str) -> None:
    qp, untouched = random_qp(3, N, M), random_qp(3, N, M)
    backend(solver, N, M).solve(qp)
    for part, original in zip(qp, untouched, strict=True):
        np.testing.assert_array_equal(part, original)


# -------------------------------------------------------------------------------------------------------- faults
@pytest.mark.filterwarnings("ignore:.*encountered in")
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_fault_is_answered_in_time_never_certified_and_forgotten(solver: str) -> None:
    kept, good = backend(solver, N, M), [random_qp(seed, N, M, unbounded=False) for seed in range(20, 22)]
    for name, fault in FAULTS.items():  # the first of them in the first tick
        begun = time.process_time()
        answer = kept.solve(fault)
        assert time.process_time() - begun < SECONDS, name
        passed, x = certified(fault, answer)
        assert not passed or (name in POSSIBLE and np.isfinite(x).all()), name
        for qp in good:
            passed, x = certified(qp, kept.solve(qp))
            assert passed, name
            np.testing.assert_allclose(x, solved(qp).x, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@settings(max_examples=8)
@given(seeds, st.integers(0, 6), st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e300]), st.data())
def test_no_number_makes_a_solver_raise(solver: str, seed: int, part: int, bad: float, data: st.DataObject) -> None:
    kept = backend(solver, N, M)
    good = random_qp(seed, N, M)
    kept.solve(good)
    numbers = [np.array(values) for values in good]
    flat = numbers[part].reshape(-1)
    flat[data.draw(st.integers(0, flat.size - 1))] = bad
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        answer = kept.solve(Instance(*numbers))
    assert [values.shape for values in answer[:3]] == [(N,), (N,), (M,)]


# --------------------------------------------------------------------------------------------------------- names
@pytest.mark.parametrize(("name", "kind"), [("proxqp", ProxqpBackend), ("osqp", OsqpBackend), ("daqp", DaqpBackend)])
def test_proxqp_osqp_and_daqp_are_ours(name: str, kind: type) -> None:
    assert isinstance(backend(name, 2, 1), kind)
    assert backend(name, 2, 1).name == name
    refuses(backend, *(((other, 2, 1), "qrqp, proxqp, osqp, daqp") for other in ("", "qpoases9000", "QRQP", None)))


def test_no_answer_of_qpsolvers_is_no_answer_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    qp = random_qp(1, N, M)
    for found, x in ((False, None), (True, None), (False, np.full(N, 2e9))):
        solution = qpsolvers.Solution(problem=to_qpsolvers(qp), found=found, x=x)
        monkeypatch.setattr(qpsolvers, "solve_problem", lambda *_, solution=solution, **__: solution)
        answer = QpsolversBackend("daqp").solve(qp)
        assert np.isnan(answer.x).all()
        assert not certified(qp, answer)[0]


@pytest.mark.parametrize("error", [ValueError("matrix"), ArithmeticError(), qpsolvers.SolverError("no")])
def test_an_exception_of_a_solver_is_no_answer(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def solve_problem(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(qpsolvers, "solve_problem", solve_problem)
    assert np.isnan(QpsolversBackend("daqp").solve(random_qp(1, N, M)).x).all()


# -------------------------------------------------------------------------------------------------- to_qpsolvers
@settings(max_examples=50)
@given(seeds, st.integers(1, 5), st.integers(0, 5))
def test_the_problem_for_qpsolvers_allows_the_same_points(seed: int, n: int, m: int) -> None:
    qp, rng = random_qp(seed, n, m), np.random.default_rng(seed)
    problem = to_qpsolvers(qp)
    truth = solved(qp).x
    for x in (truth, truth + rng.normal(scale=0.1, size=n), rng.normal(size=n)):
        ours = np.concatenate([qp.A @ x - qp.rows_upper, qp.rows_lower - qp.A @ x, qp.lower - x, x - qp.upper])
        theirs = [problem.lb - x, x - problem.ub]
        if problem.G is not None:
            theirs.append(problem.G @ x - problem.h)
        if problem.A is not None:
            theirs.append(np.abs(problem.A @ x - problem.b))
        worst = max(0.0, *np.concatenate(theirs))
        assert worst == pytest.approx(max(0.0, *ours), abs=1e-12)
        cost = 0.5 * x @ problem.P @ x + problem.q @ x
        assert cost == pytest.approx(0.5 * x @ qp.H @ x + qp.g @ x)


def test_infinite_sides_of_rows_are_left_out() -> None:
    qp = changed(A=np.eye(N)[:3], rows_lower=np.array([-np.inf, 1.0, 2.0]), rows_upper=np.array([3.0, np.inf, 2.0]))
    problem = to_qpsolvers(qp)
    np.testing.assert_array_equal(problem.G, [np.eye(N)[0], -np.eye(N)[1]])
    np.testing.assert_array_equal(problem.h, [3.0, -1.0])
    np.testing.assert_array_equal(problem.A, [np.eye(N)[2]])
    np.testing.assert_array_equal(problem.b, [2.0])
