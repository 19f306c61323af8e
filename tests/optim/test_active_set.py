"""Answers by active sets are those of another solver, from any start and where bounds meet in a corner."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
from hypothesis import assume, example, given, settings

from rehab_opt.optim.dual_active_set import active_set_round, dual_active_set
from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.fused import ANALYTIC_TOLERANCE, INDEPENDENT, PASSES
from rehab_opt.optim.qp import Form, Statement
from rehab_opt.optim.rows import Instance, equal, parameter, variable, within
from tests.optim.random_qps import general_statement, parameters_of, random_qp, seeds, solved

N, M = 5, 6


@cache
def stated() -> tuple[Form, ca.Function]:
    return general_statement(N, M).form()


def numbers_of(qp: Instance | np.ndarray) -> ca.DM:
    """Of a QP, or of its parameters."""
    return stated()[1](qp if isinstance(qp, np.ndarray) else parameters_of(qp), [])


@cache
def whole() -> ca.Function:
    return active_set_round(stated()[0], together=N, passes=3)


@cache
def dual() -> ca.Function:
    return dual_active_set(stated()[0])


@cache
def last_round() -> ca.Function:
    """As the fused function makes the dual method's answer exact."""
    return active_set_round(stated()[0], together=N, passes=PASSES, softened=INDEPENDENT)


def with_a_corner(qp: Instance, answer: np.ndarray) -> Instance:
    """The same with two rows alike and two more bounds that are met exactly at the answer."""
    matrix, low, high = qp.A.copy(), qp.rows_lower.copy(), qp.rows_upper.copy()
    matrix[1], low[1], high[1] = matrix[0], low[0], high[0]
    low[2:4], high[2:4] = -1e3, matrix[2:4] @ answer
    return qp._replace(A=matrix, rows_lower=low, rows_upper=high)


@given(seeds)
@example(4646)  # a bound met in a corner has a multiplier of -1e-17
@example(822464)  # rows so nearly dependent that a round softened by 1e-9 leaves 2e-6
@settings(max_examples=100, deadline=None)
def test_the_dual_method_finds_the_answer_whatever_bounds_meet(seed: int) -> None:
    plain = random_qp(seed, N, M, unbounded=False)
    for qp in (plain, with_a_corner(plain, solved(plain).x)):
        p = numbers_of(qp)
        found = np.array(last_round()(p, dual()(p))).ravel()
        assert 0.0 <= found[-1] <= 1e-8
        np.testing.assert_allclose(found[:N], solved(qp).x, atol=1e-6)


@given(seeds)
@settings(max_examples=100, deadline=None)
def test_with_the_right_bounds_one_round_is_the_answer(seed: int) -> None:
    qp = random_qp(seed, N, M, unbounded=False)
    answer = solved(qp)
    active = np.concatenate([answer.bounds, answer.rows])
    active[np.abs(active) < 1e-7] = 0.0
    found = np.array(whole()(numbers_of(qp), active)).ravel()
    assert 0.0 <= found[-1] <= 1e-6
    np.testing.assert_allclose(found[:N], answer.x, atol=1e-5)


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_a_wrong_set_is_never_certified(seed: int) -> None:
    qp, rng = random_qp(seed, N, M, unbounded=False), np.random.default_rng(seed)
    start = rng.choice([-1.0, 0.0, 1.0], N + M)
    found = np.array(whole()(numbers_of(qp), start)).ravel()
    right = np.allclose(found[:N], solved(qp).x, atol=1e-6)
    assert right or not 0.0 <= found[-1] <= 1e-9


def test_a_number_that_is_none_is_never_certified() -> None:
    qp = random_qp(1, N, M, unbounded=False)
    for k in range(parameters_of(qp).size):
        p = parameters_of(qp)
        p[k] = np.nan
        residual = float(whole()(numbers_of(p), dual()(numbers_of(p)))[-1])
        assert not 0.0 <= residual <= 1e-8, k


def nearest_in_a_box(*, active_set: bool) -> FallbackChain:
    """The point nearest to p on a plane, in a box, behind six walls that meet in corners."""
    p, x = parameter("p", 3), variable("x", 3, lower=-1, upper=1)
    walls = np.vstack([np.random.default_rng(0).standard_normal((4, 3)), np.ones((2, 3))])
    statement = Statement(
        name=f"nearest_{active_set:d}",
        parameters=[p],
        variables=[x],
        minimise=ca.sumsqr(x.symbol - p) / 2,
        subject_to=[equal(x.symbol[0] - x.symbol[1], 0.1), within(ca.DM(walls) @ x.symbol, -np.inf, 0.5)],
    )
    return FallbackChain(
        replace(statement, active_set=active_set), solver="qrqp", backup=None, tolerance=1e-8, compile=False
    )


def test_active_sets_give_the_solver_s_answers_along_jumps() -> None:
    rng, by_rounds, by_solver = (
        np.random.default_rng(3),
        nearest_in_a_box(active_set=True),
        nearest_in_a_box(active_set=False),
    )
    names = []
    for _ in range(200):
        point = 2 * rng.standard_normal(3)
        for chain in (by_rounds, by_solver):
            chain.parameters[:] = point
        names.append(by_rounds())
        assert by_solver()
        np.testing.assert_allclose(by_rounds.x, by_solver.x, atol=1e-7)
    assert {"active set", "dual active set"} == set(names)


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_rows_that_nearly_depend_are_held_as_exactly_as_others(seed: int) -> None:
    """Two rows 1e-5 apart, both active at the answer: their multipliers nearly cancel."""
    rng, qp = np.random.default_rng(seed), random_qp(seed, N, M, unbounded=False)
    matrix, far = qp.A.copy(), np.full(M, 1e3)
    matrix[1] = matrix[0] + 1e-5 * rng.standard_normal(N)
    first, second = matrix[:2] @ np.linalg.cholesky(np.linalg.inv(qp.H))
    beside = second - first * (first @ second) / (first @ first)
    assume(beside @ beside > 3e-11 * (second @ second))  # where less is left, rounding decides the answer
    inside, high = rng.standard_normal(N), far.copy()
    high[:2] = matrix[:2] @ inside
    gradient = -qp.H @ inside - matrix[:2].T @ rng.uniform(0.5, 2.0, 2) * 100
    qp = Instance(qp.H, gradient, matrix, -far, high, np.full(N, -1e3), np.full(N, 1e3))
    answer = np.array(last_round()(numbers_of(qp), dual()(numbers_of(qp)))).ravel()
    assert 0.0 <= answer[-1] <= ANALYTIC_TOLERANCE
    np.testing.assert_allclose(answer[:N], inside, atol=1e-9)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_where_no_point_keeps_all_bounds_the_dual_method_ends_and_nothing_is_certified(seed: int) -> None:
    qp = random_qp(seed, N, M, unbounded=False)
    matrix, low, high = qp.A.copy(), qp.rows_lower.copy(), qp.rows_upper.copy()
    matrix[1], low[1], high[1] = matrix[0], high[0] + 1.0, high[0] + 2.0
    p = numbers_of(qp._replace(A=matrix, rows_lower=low, rows_upper=high))
    active = np.array(dual()(p)).ravel()
    assert set(active) <= {-1.0, 0.0, 1.0}
    assert not 0.0 <= float(last_round()(p, active)[0][-1]) <= 1e-6
