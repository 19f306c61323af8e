"""A nonlinear programme is stated once; whoever solves it, the certificate is ours."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.nlp import NLP, convexified
from rehab_opt.optim.nlp_solvers import nlp_solver
from rehab_opt.optim.rows import equal, parameter, variable, within
from rehab_opt.symbolic import Compile

SOLVERS = ["sqp", "ipopt", "fatrop", "sqpmethod"]


def valley(*, sum_to: float | None = None) -> NLP:
    """Rosenbrock's valley inside a disc, optionally on a line; parameter: its steepness."""
    x, steepness = variable("x", 2, lower=-2, upper=2), parameter("steepness", 1)
    a, b = x.symbol[0], x.symbol[1]
    rows = [within(a**2 + b**2, -ca.inf, 1.5)]
    if sum_to is not None:
        rows.append(equal(a + b, sum_to))
    return NLP("valley", [steepness], [x], (1 - a) ** 2 + steepness * (b - a**2) ** 2, rows, report=ca.sumsqr(x.symbol))


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.usefixtures("machine_code")
@pytest.mark.parametrize("compile", [False, "wait"])
def test_every_solver_agrees_with_scipy(name: str, compile: Compile) -> None:
    solver = nlp_solver(valley(), name, compile=compile)
    solver.parameters[:] = 3.0
    answer = solver.solve([0.5, 0.5])
    reference = minimize(
        lambda v: (1 - v[0]) ** 2 + 3 * (v[1] - v[0] ** 2) ** 2,
        [0.5, 0.5],
        constraints={"type": "ineq", "fun": lambda v: 1.5 - v @ v},
        bounds=[(-2, 2)] * 2,
        options={"ftol": 1e-14},
    )
    assert answer.certified
    assert answer.solver == name
    np.testing.assert_allclose(answer.x, reference.x, atol=1e-5)
    assert answer.report[0] == pytest.approx(answer.x @ answer.x)


@pytest.mark.parametrize("name", SOLVERS)
def test_multipliers_are_positive_at_an_upper_bound(name: str) -> None:
    solver = nlp_solver(valley(), name, compile=False)
    solver.parameters[:] = 1.0
    answer = solver.solve([0.5, 0.5])
    row = answer.multipliers[2]
    assert row > 1e-3
    x = ca.SX.sym("x", 2)
    f = (1 - x[0]) ** 2 + (x[1] - x[0] ** 2) ** 2
    gradient = ca.Function("g", [x], [ca.gradient(f, x)])(answer.x).full().reshape(-1)
    np.testing.assert_allclose(gradient + row * 2 * answer.x, 0.0, atol=1e-8)


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.usefixtures("machine_code")
@pytest.mark.parametrize("compile", [False, "wait"])
def test_an_infeasible_problem_is_never_certified(name: str, compile: Compile) -> None:
    solver = nlp_solver(valley(sum_to=3.0), name, compile=compile)  # the line misses the disc
    solver.parameters[:] = 1.0
    answer = solver.solve([0.5, 0.2])
    assert not answer.certified
    assert not answer.residual <= 1e-3


@pytest.mark.usefixtures("machine_code")
@pytest.mark.parametrize("compile", [False, "wait"])
def test_a_failed_qp_does_not_leave_the_last_certificate_standing(compile: Compile) -> None:
    x, total = variable("x", 4, lower=-1, upper=1), parameter("total", 1)
    slope = ca.DM([1, 2, 3, 4]).T
    nlp = NLP("sum_of_four", [total], [x], ca.sumsqr(x.symbol), [equal(slope @ x.symbol, total)])
    solver = nlp_solver(nlp, "sqp", compile=compile)
    solver.parameters[:] = 5.0
    assert solver.solve(np.zeros(4)).certified
    solver.parameters[:] = 100.0  # compiled, the QP's failure ends the function before it writes its outputs
    assert not solver.solve(np.zeros(4)).certified


@pytest.mark.parametrize("name", SOLVERS)
@given(
    start=st.lists(st.sampled_from([0.0, 1.0, -3.0, np.nan, np.inf, -np.inf, 1e300]), min_size=2, max_size=2),
    steepness=st.sampled_from([1.0, 0.0, np.nan, np.inf, 1e300]),
)
@settings(max_examples=30, deadline=None)
def test_hostile_numbers_are_survived(name: str, start: list[float], steepness: float) -> None:
    solver = HOSTED.setdefault(name, nlp_solver(valley(sum_to=1.2), name, compile=False))
    solver.parameters[:] = steepness
    answer = solver.solve(start)
    assert answer.certified == (0 <= answer.residual <= 1e-9)
    if answer.certified:
        assert np.all(np.abs(answer.x) <= 2)
        assert answer.x.sum() == pytest.approx(1.2, abs=1e-9)
    if not abs(steepness) <= 1e9:
        assert not answer.certified


HOSTED: dict[str, object] = {}


@given(seed=st.integers(0, 2**32 - 1), where=st.integers(0, 10))
@settings(max_examples=60, deadline=None)
def test_the_certificate_fails_a_nan_wherever_it_is(seed: int, where: int) -> None:
    nlp = valley(sum_to=1.2)
    rng = np.random.default_rng(seed)
    numbers = [np.array([1.0]), rng.normal(size=2), rng.normal(size=4)]
    flat = np.concatenate(numbers)
    flat[where % flat.size] = np.nan
    residual = float(nlp.certify(flat[:1], flat[1:3], flat[3:])[2])
    assert not 0 <= residual <= 1e300


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_the_certificate_is_the_kkt_residual_in_numpy(seed: int) -> None:
    nlp = valley(sum_to=1.2)
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1.9, 1.9, 2), rng.normal(size=4)
    _, _, residual, violation, _ = (np.array(each).reshape(-1) for each in nlp.certify(1.0, x, y))
    a, b = x
    gradient = np.array([-2 * (1 - a) - 4 * a * (b - a * a), 2 * (b - a * a)])
    stationarity = gradient + y[:2] + y[2] * 2 * x + y[3]
    missed = np.array([max(0.0, x @ x - 1.5), abs(a + b - 1.2)])
    slack = [min(1, 2 - v) if u > 0 else min(1, v + 2) for u, v in zip(y[:2], x, strict=True)]
    slackness = [*(abs(y[:2]) * slack), abs(y[2]) * (1.0 if y[2] < 0 else np.clip(1.5 - x @ x, 0, 1))]
    over = y[3] > 0
    slackness.append(abs(y[3]) * min(1, max(0, (1.2 - a - b) if over else (a + b - 1.2))))
    expected = np.sqrt(stationarity @ stationarity + missed @ missed + np.dot(slackness, slackness))
    assert residual[0] == pytest.approx(expected)
    assert violation[0] == pytest.approx(np.linalg.norm(missed))


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 8), definite=st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_convexified_hessian_is_positive_definite_and_unchanged_where_it_was(
    seed: int, n: int, definite: bool
) -> None:
    rng = np.random.default_rng(seed)
    square = rng.normal(size=(n, n))
    symmetric = square @ square.T + 0.5 * np.trace(square @ square.T) * np.eye(n) if definite else square + square.T
    h = ca.SX.sym("h", n, n)
    result = ca.Function("convexified", [h], [convexified(h)])(symmetric).full()
    assert np.linalg.eigvalsh(result).min() > 0
    if definite:
        np.testing.assert_allclose(result, symmetric, atol=1e-12 * np.abs(symmetric).max())


def test_what_cannot_be_used_is_named() -> None:
    x, p = variable("x", 1), parameter("p", 1)
    with pytest.raises(ConfigurationError, match="solver = 'nonesuch'"):
        nlp_solver(valley(), "nonesuch")
    with pytest.raises(ConfigurationError, match="tolerance"):
        nlp_solver(valley(), "ipopt", tolerance=0.0)
    with pytest.raises(ConfigurationError, match="minimise"):
        NLP("bad", [p], [x], ca.vertcat(x.symbol, x.symbol))
    with pytest.raises(ConfigurationError, match="variables"):
        NLP("bad", [p], [], p)
    with pytest.raises(ConfigurationError, match="subject_to"):
        NLP("bad", [p], [x], x.symbol, [within(x.symbol, 0, x.symbol + p)])
