"""Equalities that say the same twice do not stop the solver, and those that contradict each other are no answer."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.fused import FUSED_SOLVERS, dependent_equalities
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import equal, parameter, variable, within

N, ROWS = 5, 4
Array = np.ndarray


def statement() -> Statement:
    """The point of a box nearest to p where `rows` x = `levels`, whatever these numbers are, behind a wall."""
    p, rows, levels = parameter("p", N), parameter("rows", ROWS * N), parameter("levels", ROWS)
    held = parameter("held", N)
    x = variable("x", N, lower=ca.fmax(-1, held), upper=ca.fmin(1, ca.if_else(held > -1, held, 1)))
    return Statement(
        "dependent", [p, rows, levels, held], [x], ca.sumsqr(x.symbol - p) / 2,
        [equal(ca.reshape(rows, ROWS, N) @ x.symbol, levels), within(ca.sum1(x.symbol), -np.inf, 2.0)],
    )  # fmt: skip


STATEMENT = statement()
CHAIN = FallbackChain(STATEMENT, solver="qrqp", backup="osqp", tolerance=1e-8, compile=False)
FORM, NUMBERS = STATEMENT.form()
DEPENDENT = dependent_equalities(FORM)
FREE = np.full(N, -2.0)


def asked(p: Array, rows: Array, levels: Array, held: Array = FREE) -> Array:
    return np.concatenate([p, rows.reshape(-1, order="F"), levels, held])


def dependent(rows: Array, held: Array = FREE) -> list[int]:
    assert DEPENDENT is not None
    found = DEPENDENT(NUMBERS(asked(np.zeros(N), rows, np.zeros(ROWS), held), []))
    return np.flatnonzero(np.array(found).reshape(-1)).tolist()


@settings(max_examples=100)
@given(st.integers(0, 10**6), st.integers(1, ROWS), st.floats(-3, 3))
def test_as_many_rows_are_independent_as_the_rank_says(seed: int, rank: int, order: float) -> None:
    rng = np.random.default_rng(seed)
    rows = 10.0**order * rng.normal(size=(ROWS, rank)) @ rng.normal(size=(rank, N))
    assert dependent(rows) == list(range(rank, ROWS))  # of random rows the first ones


@settings(max_examples=60)
@given(st.integers(0, 10**6))
def test_equalities_that_stand_twice_or_are_empty_change_no_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    two, inside = rng.normal(size=(2, N)), rng.uniform(-0.5, 0.5, N)
    rows, p = np.vstack([two, two]), rng.normal(size=N)
    CHAIN.warm_start(0.0)
    CHAIN.parameters[:] = asked(p, rows, rows @ inside)
    assert CHAIN()
    x = CHAIN.x.copy()
    np.testing.assert_allclose(rows @ x, rows @ inside, atol=1e-8)
    # Two of them and two empty ones are the same problem.
    CHAIN.warm_start(0.0)
    CHAIN.parameters[:] = asked(p, np.vstack([two, 0 * two]), np.concatenate([two @ inside, [0.0, 0.0]]))
    assert CHAIN()
    np.testing.assert_allclose(CHAIN.x, x, atol=1e-8)


def test_nearly_all_random_ones_of_low_rank_need_no_backup() -> None:
    who = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        inside, rows = rng.uniform(-0.5, 0.5, N), rng.normal(size=(ROWS, 2)) @ rng.normal(size=(2, N))
        CHAIN.warm_start(0.0)
        CHAIN.parameters[:] = asked(rng.normal(size=N), rows, rows @ inside)
        who.append(CHAIN())
    assert sum(each in FUSED_SOLVERS for each in who) >= 0.95 * len(who)
    assert "" not in who


def test_a_row_over_held_variables_alone_is_let_go_and_still_certified() -> None:
    held = np.array([0.3, -2.0, -2.0, -2.0, -2.0])
    rows = np.vstack([np.eye(N)[0], np.eye(N)[1], np.eye(N)[0] + np.eye(N)[1], np.eye(N)[2]])
    assert dependent(rows, held) == [0, 2]
    CHAIN.warm_start(0.0)
    CHAIN.parameters[:] = asked(np.ones(N), rows, np.array([0.3, 0.1, 0.4, 0.2]), held)
    assert CHAIN() in FUSED_SOLVERS
    np.testing.assert_allclose(CHAIN.x[:3], [0.3, 0.1, 0.2], atol=1e-8)


@pytest.mark.parametrize("apart", [1e-6, 0.1])
def test_rows_that_contradict_each_other_are_no_answer(apart: float) -> None:
    row = np.array([1.0, 2.0, 0.0, 0.0, 1.0])
    rows = np.vstack([row, row, np.eye(N)[2], np.eye(N)[3]])
    CHAIN.warm_start(0.0)
    CHAIN.parameters[:] = asked(np.zeros(N), rows, np.array([0.1, 0.1 + apart, 0.0, 0.0]))
    assert CHAIN() == ""


def test_nothing_is_asked_of_a_statement_without_equalities() -> None:
    x = variable("x", 2)
    plain = Statement("plain", [], [x], ca.sumsqr(x.symbol), [within(ca.sum1(x.symbol), -1, 1)])
    assert dependent_equalities(plain.form()[0]) is None
    assert (plain.form()[0].rows(), FORM.rows()) == (([], [0]), ([*range(ROWS)], [ROWS]))
