"""Shortcuts of the fused function never change an answer: what they find is certified against the whole statement."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import strategies as st

from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import equal, parameter, variable, within

rng_seeds = st.integers(0, 10**6)
WALLS = np.random.default_rng(0).standard_normal((4, 3))


def solved(chain: FallbackChain, *values: np.ndarray) -> tuple[str, np.ndarray]:
    chain.parameters[:] = np.concatenate(values)
    return chain(), chain.x.copy()


def test_the_third_chain_of_a_statement_answers_as_the_first_to_the_last_bit_and_as_no_other_statement() -> None:
    """They share a solver; what differs in one number of the QP has other answers."""
    rng = np.random.default_rng(8)
    cases = [(2 * rng.standard_normal(3), rng.uniform(0.2, 2.0, 4)) for _ in range(60)]

    def answers(level: float, upper: float) -> list[tuple[str, bytes]]:
        p, offsets, x = parameter("p", 3), parameter("offsets", 4), variable("x", 3, lower=-1, upper=upper)
        rows = [equal(ca.sum1(x.symbol), level), within(ca.DM(WALLS) @ x.symbol, -np.inf, offsets)]
        cost = ca.sumsqr(x.symbol - p) / 2
        statement = Statement("again", [p, offsets], [x], cost, rows, active_set=True)
        chain = FallbackChain(statement, solver="qrqp", backup=None, tolerance=1e-8, compile=False)
        found = []
        for case in cases:
            name, at = solved(chain, *case)
            assert name
            assert abs(at.sum() - level) < 1e-7
            assert np.all(at <= upper + 1e-9)
            found.append((name, at.tobytes()))
        return found

    forms = [(0.1, 1.0), (0.2, 1.0), (0.1, 0.5)]
    first = {form: answers(*form) for form in forms}
    assert len({tuple(each) for each in first.values()}) == 3
    for _ in range(3):
        for form in forms:
            assert answers(*form) == first[form]


def guessed(multipliers: bool, *, wrong: float = 0.0) -> FallbackChain:
    """The nearest point on a plane before a wall, guessed by its closed form, which knows no wall."""
    p, x = parameter("p", 3), variable("x", 3, lower=-1, upper=1)
    lift = (ca.sum1(p) - 0.1) / 3
    statement = Statement(
        name="guessed",
        parameters=[p],
        variables=[x],
        minimise=ca.sumsqr(x.symbol - p) / 2,
        subject_to=[equal(ca.sum1(x.symbol), 0.1), within(x.symbol[0], -0.9, 0.9)],
        analytic=p - lift,
        dual=ca.vertcat(lift + wrong, 0) if multipliers else None,
    )
    return FallbackChain(statement, solver="qrqp", backup=None, tolerance=1e-8, compile=False)


def test_a_guess_on_active_rows_is_certified_by_its_multipliers() -> None:
    inside, outside = np.array([0.3, 0.2, -0.1]), np.array([3.0, 0.2, -0.1])
    assert solved(guessed(True), inside)[0] == "closed form"
    assert solved(guessed(False), inside)[0] == "qrqp"  # without them it is no answer, and the solver finds it
    assert solved(guessed(True, wrong=1e-6), inside)[0] == "qrqp"
    for place in (outside, np.array([0.95, 0.05, -0.9])):  # the wall is active, in the box or not: the guess is none
        name, x = solved(guessed(True), place)
        assert name == "qrqp"
        assert x[0] == pytest.approx(0.9)


def test_a_guess_pressed_against_a_bound_is_an_answer_and_one_pressed_away_is_none() -> None:
    p, x = parameter("p", 1), variable("x", 1, lower=0, upper=1)
    y = variable("y", 1)
    statement = Statement(
        name="pressed",
        parameters=[p],
        variables=[x, y],
        minimise=p * x.symbol + y.symbol**2 / 2,
        subject_to=[equal(y.symbol, x.symbol)],
        analytic=ca.SX.ones(2),
        dual=ca.SX(-1),
    )
    chain = FallbackChain(statement, solver="qrqp", backup=None, tolerance=1e-8, compile=False)
    assert solved(chain, np.array([-3.0]))[0] == "closed form"
    name, x_away = solved(chain, np.array([0.5]))
    assert name == "qrqp"
    np.testing.assert_allclose(x_away, 0.0, atol=1e-9)
    assert solved(chain, np.array([np.nan]))[0] == ""


@pytest.mark.parametrize(("violation", "expected"), [(0.0, True), (1e-9, True), (1e-6, False), (np.nan, False)])
@pytest.mark.parametrize("solver", ["qrqp", "proxqp"])
def test_what_is_made_of_an_answer_is_certified_with_it(violation: float, expected: bool, solver: str) -> None:
    p, x = parameter("p", 1), variable("x", 1)
    statement = Statement(
        name="made",
        parameters=[p],
        variables=[x],
        minimise=(x.symbol - p) ** 2 / 2,
        violation=ca.SX(violation) + 0 * p,
    )
    chain = FallbackChain(statement, solver=solver, backup=None, tolerance=1e-8, compile=False)
    assert bool(solved(chain, np.array([0.5]))[0]) is expected
