"""A statement means the QP that one would write down by hand."""

from functools import partial

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import MAX_MAGNITUDE, equal, parameter, variable, within
from rehab_opt.symbolic.tick import Stages
from tests.optim.random_qps import general_statement, parameters_of, random_qp, seeds, sizes
from tests.refusals import refuses

numbers = st.floats(-5, 5)


def reach() -> Statement:
    """Joint speeds v and a scale s: 1/2 |v|^2 - b'v - 10 s, A v = s t, v within bounds that follow the parameters."""
    b, t, gap = parameter("b", 2), parameter("t", 1), parameter("gap", 1)
    v = variable("v", 2, lower=-1 - gap, upper=ca.vertcat(1 + gap, 2))
    s = variable("s", 1, lower=0, upper=1)
    x, y = v.symbol[0], v.symbol[1]
    return Statement(
        "reach", [b, t, gap], [v, s], 0.5 * ca.sumsqr(v.symbol) - b.T @ v.symbol + 2 * x * y - 10 * s.symbol,
        [equal(x + 3 * y + t, s.symbol * t), within(2 * x - y + 1, -4, 4 * gap), within(y, -ca.inf, gap)],
    )  # fmt: skip


REACH = reach()


@given(st.tuples(numbers, numbers), numbers, st.floats(0, 3))
def test_an_instance_is_what_one_writes_by_hand(b: tuple[float, float], t: float, gap: float) -> None:
    qp = REACH.instance(b, t, gap)
    np.testing.assert_allclose(qp.H, [[1, 2, 0], [2, 1, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(qp.g, [-b[0], -b[1], -10], atol=1e-12)
    np.testing.assert_allclose(qp.A, [[1, 3, -t], [2, -1, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(qp.rows_lower, [-t, -5, -np.inf], atol=1e-12)
    np.testing.assert_allclose(qp.rows_upper, [-t, 4 * gap - 1, gap], atol=1e-12)
    np.testing.assert_allclose(qp.lower, [-1 - gap, -1 - gap, 0], atol=1e-12)
    np.testing.assert_allclose(qp.upper, [1 + gap, 2, 1], atol=1e-12)


@settings(max_examples=40)
@given(seeds, sizes)
def test_an_instance_gives_back_the_numbers_that_went_in(seed: int, size: tuple[int, int]) -> None:
    qp = random_qp(seed, *size, unbounded=False)
    for ours, theirs in zip(GENERAL[size].instance(parameters_of(qp)), qp, strict=True):
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


GENERAL = {(n, m): general_statement(n, m) for n in range(1, 8) for m in range(6)}
GENERAL[1, 0].instance(np.zeros(4))


def test_memory_enters_the_instance() -> None:
    p, memory = parameter("p", 1), ca.SX.sym("memory", 2)
    x = variable("x", 2, lower=memory - 1, upper=memory + 1)
    statement = Statement("kept", [p], [x], ca.sumsqr(x.symbol - p), memory=memory, remember=x.symbol)
    qp = statement.instance(0.5, memory=[3, 4])
    np.testing.assert_array_equal(qp.lower, [2, 3])
    np.testing.assert_array_equal(qp.upper, [4, 5])
    assert statement.state_size == 2 * 2 + 2


def test_what_is_marked_is_a_number_of_the_problem() -> None:
    p, memory, tick = parameter("p", 2), ca.SX.sym("memory", 1), Stages()
    x, doubled = variable("x", 2), tick.once(2 * p + memory)
    cost = 0.5 * ca.sumsqr(x.symbol - doubled)
    statement = Statement("marked", [p], [x], cost, tick=tick, memory=memory, remember=memory)
    np.testing.assert_allclose(statement.instance([1, 2], memory=[0.5]).g, [-2.5, -4.5])
    chain = FallbackChain(statement, solver="qrqp", backup="proxqp", tolerance=1e-6, compile=False)
    chain.parameters[:], chain.memory[:] = (1, 2), 0.5
    assert chain()
    np.testing.assert_allclose(chain.x, [2.5, 4.5], atol=1e-9)


# ------------------------------------------------------------------------------------------ equal() and within()


def test_a_number_on_either_side_of_an_equality_means_the_same() -> None:
    p, x = parameter("p", 1), variable("x", 1)
    for row in (equal(x.symbol, 2 * p), equal(2 * p, x.symbol)):
        qp = Statement("side", [p], [x], ca.sumsqr(x.symbol), [row]).instance(3)
        assert (qp.rows_lower / qp.A[0]).tolist() == (qp.rows_upper / qp.A[0]).tolist() == [6]


def test_a_scalar_bound_stands_for_every_row() -> None:
    p, x = parameter("p", 1), variable("x", 3, lower=-2)
    qp = Statement("scalar", [p], [x], ca.sumsqr(x.symbol), [within(x.symbol, -p, 1)]).instance(0.5)
    assert qp.rows_lower.tolist() == [-0.5] * 3
    assert qp.rows_upper.tolist() == [1] * 3
    assert qp.lower.tolist() == [-2] * 3
    assert qp.upper.tolist() == [np.inf] * 3


# ----------------------------------------------------------------------------------------------- what is no QP
X, P = variable("x", 2), parameter("p", 2)


# ------------------------------------------------------------------------------- the same answer by other means


@settings(max_examples=40)
@given(
    st.integers(0, 3),
    st.one_of(
        st.sampled_from([np.nan, np.inf, -np.inf]),
        st.floats(min_value=1.0001 * MAX_MAGNITUDE, max_value=1e308),
        st.floats(max_value=-1.0001 * MAX_MAGNITUDE, min_value=-1e308),
    ),
)
def test_implausible_parameters_are_unsound(place: int, bad: float) -> None:
    values = np.zeros(4)
    values[place] = bad
    assert float(REACH.build(values, [])[7]) == 0
    assert float(REACH.screen(values, [])[2]) == 0


@given(st.lists(st.floats(-MAX_MAGNITUDE / 2, MAX_MAGNITUDE / 2), min_size=4, max_size=4))
def test_plausible_parameters_are_sound(values: list[float]) -> None:
    assert float(REACH.build(values, [])[7]) == 1
    assert float(REACH.screen(values, [])[2]) == 1


@given(numbers, numbers)
def test_data_are_sound_where_all_that_is_required_holds(first: float, second: float) -> None:
    assert float(REQUIRING.build([first, second], [])[7]) == (first > 0 and second <= first)


REQUIRING = Statement("r", [P], [X], ca.sumsqr(X.symbol), requires=[P[0] > 0, P[1] <= P[0]])


def test_what_is_no_qp_is_refused() -> None:
    x, cost = X.symbol, ca.sumsqr(X.symbol)
    state = partial(Statement, "s", [P])
    costs = x[0] ** 3, ca.sin(x[0]), x[0] ** 2 * x[1], ca.exp(ca.sum1(x)), 1 / x[0]
    refuses(state, *((([X], each), "minimise", "quadratic") for each in costs))
    rows = within(ca.sumsqr(x), 0, 1), equal(x[0] * x[1], 1), within(ca.cos(x), 0, 1)
    refuses(state, *((([X], cost, [each]), "subject_to", "linear") for each in rows))
    bounds = within(P, x, 3), within(P, -3, x), within(P, x, 2 * x)
    refuses(state, *((([X], cost, [each]), "equality") for each in bounds))
    other, stranger = variable("other", 1, upper=x[0]), ca.SX.sym("stranger")
    refuses(
        state,
        (([X, other], cost + other.symbol, []), "variables"),
        (([X], cost * stranger, []), "stranger"),
        (([X], cost, [within(x[0], stranger, 1)]), "stranger"),
        (([X], x, []), "minimise"),
    )


def test_what_is_made_of_an_answer_beforehand_is_what_is_made_of_it_after() -> None:
    p, memory, x = parameter("p", 2), parameter("memory", 3), variable("x", 2)
    stated = Statement(
        "two", [p], [x], ca.sumsqr(x.symbol - p), report=x.symbol.T @ memory[:2], memory=memory,
        remember=ca.vertcat(x.symbol, p[0] * memory[2]), violation=memory[2] + p[1],
    )  # fmt: skip
    given, kept, answer = np.array([0.3, -2.0]), np.array([5.0, 7.0, 11.0]), ca.vertcat(memory[2], p[1])
    found = stated.finish_at(answer)(given, kept)
    for one, other in zip(found, ([11 * 5 - 2 * 7], [11, -2, 3.3], [9]), strict=True):
        np.testing.assert_allclose(np.array(one).ravel(), other, atol=1e-12)
