"""An answer leaves with its certificate or not at all, whoever gave it."""

import dataclasses
from collections.abc import Callable, Iterator
from functools import partial

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.optim import backends
from rehab_opt.optim.backends import Answer, backend
from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import MAX_MAGNITUDE, Instance, parameter, variable, within
from tests.optim.random_qps import Array, general_statement, parameters_of, random_qp, seeds, solved
from tests.refusals import refuses

TOLERANCE = 1e-6
SOLVERS = ["qrqp", "proxqp", "osqp", "daqp"]
N, M = 4, 2

Broken = Callable[[Instance], Answer]


def counting(*, guess: bool = False, rows: bool = True) -> Statement:
    """The point of a box nearest to p; the memory counts certified ticks."""
    p, memory = parameter("p", 2), ca.SX.sym("memory", 1)
    x = variable("x", 2, lower=-1, upper=1)
    return Statement(
        "counting", [p], [x], 0.5 * ca.sumsqr(x.symbol - p),
        [within(x.symbol[0] + x.symbol[1], -1.5, 1.5)] if rows else [],
        requires=[p[0] >= -2], report=ca.vertcat(ca.sum1(x.symbol), memory), analytic=p if guess else None,
        memory=memory, remember=memory + 1,
    )  # fmt: skip


def made(statement: Statement | None = None, *, solver: str = "qrqp", backup: str = "daqp") -> FallbackChain:
    return FallbackChain(statement or counting(), solver=solver, backup=backup, tolerance=TOLERANCE, compile=False)


@pytest.fixture
def made_to_fail(monkeypatch: pytest.MonkeyPatch) -> Callable[[dict[str, Broken]], None]:
    """Put a stub in the place of named backends."""

    def replace(stubs: dict[str, Broken]) -> None:
        class Stub:
            def __init__(self, name: str) -> None:
                self.name, self.solve = name, stubs[name]

        def chosen(name: str, n: int, m: int, **others: str) -> object:
            return Stub(name) if name in stubs else backend(name, n, m, **others)

        monkeypatch.setattr(backends, "backend", chosen)

    return replace


def garbage(qp: Instance) -> Answer:
    return Answer(np.full(qp.g.size, 2e9), np.full(qp.g.size, 2e9), np.full(qp.rows_lower.size, -2e9), 10)


def nan(qp: Instance) -> Answer:
    return Answer(np.full(qp.g.size, np.nan), np.full(qp.g.size, np.nan), np.full(qp.rows_lower.size, np.nan), 10)


def nan_among_good_numbers(qp: Instance) -> Answer:
    good = solved(qp)
    return Answer(np.array([good.x[0], np.nan]), *good[1:], 10)


def without_multipliers(qp: Instance) -> Answer:
    return Answer(np.clip(solved(qp).x + 0.01, -1, 1), np.zeros(qp.g.size), np.zeros(qp.rows_lower.size), 10)


def infinite(qp: Instance) -> Answer:
    return Answer(np.full(qp.g.size, -np.inf), np.zeros(qp.g.size), np.zeros(qp.rows_lower.size), 10)


FAILURES = [garbage, nan, nan_among_good_numbers, without_multipliers, infinite]


# ------------------------------------------------------------------------------------------------------- primary
@pytest.mark.parametrize("solver", SOLVERS)
@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_what_is_certified_is_the_solution(solver: str, seed: int) -> None:
    qp = random_qp(seed, N, M, unbounded=False)
    chain = made(GENERAL, solver=solver, backup="daqp" if solver != "daqp" else "qrqp")
    chain.parameters[:] = parameters_of(qp)
    assert chain()
    assert 0 <= chain.residual[0] <= TOLERANCE
    np.testing.assert_allclose(chain.x, solved(qp).x, atol=1e-6)


@pytest.mark.parametrize(
    ("solver", "rows", "least"),
    [("qrqp", 0, 1.0), ("qrqp", M, 0.85), ("proxqp", M, 1.0), ("osqp", M, 0.99), ("daqp", M, 1.0)],
)
def test_the_primary_answers_nearly_always_and_its_backup_else(solver: str, rows: int, least: float) -> None:
    """A tenth of random QPs with rows is too much for qrqp, also in casadi's own hands and with more iterations."""
    chain = made(general_statement(N, rows), solver=solver, backup="daqp" if solver != "daqp" else "osqp")
    answers = []
    for seed in range(200):
        chain.warm_start(0.0)
        chain.parameters[:] = parameters_of(random_qp(seed, N, rows, unbounded=False))
        answers.append(chain())
    primary = FUSED_SOLVERS if solver == "qrqp" else (solver,)
    assert sum(who in primary for who in answers) >= least * len(answers)
    assert "" not in answers


GENERAL = general_statement(N, M)


@pytest.mark.usefixtures("shipped")
def test_machine_code_and_virtual_machine_give_the_same_answers() -> None:
    machine = FallbackChain(GENERAL, solver="qrqp", backup="daqp", tolerance=TOLERANCE, compile="wait")
    virtual = made(GENERAL)
    for seed in range(100):  # one after another: warm starts as well
        numbers = parameters_of(random_qp(seed, N, M, unbounded=False))
        machine.parameters[:] = virtual.parameters[:] = numbers
        assert machine() == virtual()
        np.testing.assert_allclose(machine.x, virtual.x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
def test_report_and_memory_are_those_of_the_answer(solver: str) -> None:
    chain = made(solver=solver, backup="qrqp")
    for tick in range(3):
        chain.parameters[:] = 0.3, 0.1 * tick
        assert chain()
        assert chain.report.tolist() == pytest.approx([0.3 + 0.1 * tick, tick], abs=1e-6)
        assert chain.memory.tolist() == [tick + 1]


# ------------------------------------------------------------------------------- guess and last active set
@given(st.lists(st.floats(-1.9, 1.9), min_size=2, max_size=2))
@settings(max_examples=60)
def test_a_guess_changes_who_answers_and_not_what(p: list[float]) -> None:
    PLAIN.parameters[:] = GUESSING.parameters[:] = p
    assert PLAIN()
    who = GUESSING()
    np.testing.assert_allclose(GUESSING.x, PLAIN.x, atol=1e-9)
    inside = max(abs(p[0]), abs(p[1])) <= 1 and abs(p[0] + p[1]) <= 1.5
    assert (who == "closed form") == inside


PLAIN, GUESSING = made(counting()), made(counting(guess=True))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 0.3])
def test_a_wrong_guess_is_not_the_answer(wrong: float) -> None:
    p, x = parameter("p", 2), variable("x", 2, lower=-1, upper=1)
    statement = Statement("wrong", [p], [x], 0.5 * ca.sumsqr(x.symbol - p), analytic=p + wrong)
    chain = made(statement)
    chain.parameters[:] = 0.2, 0.4
    assert chain() in {"qrqp", "active set"}
    np.testing.assert_allclose(chain.x, [0.2, 0.4], atol=1e-9)


@pytest.mark.usefixtures("shipped")
@pytest.mark.parametrize("bad", [np.nan, 2 * MAX_MAGNITUDE])
@pytest.mark.parametrize(("rows", "compile"), [(True, False), (False, "wait")])
def test_a_guess_without_gradient_by_its_form_is_not_certified_for_bad_parameters(
    bad: float, rows: bool, compile: bool
) -> None:
    statement = counting(guess=True, rows=rows)  # the gradient p - p vanishes already in the expression
    chain = FallbackChain(statement, solver="qrqp", backup="daqp", tolerance=TOLERANCE, compile=compile)
    chain.parameters[:] = 0.1, bad
    assert chain() == ""
    assert not 0 <= chain.residual[0] <= TOLERANCE
    assert np.isfinite(chain.state).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_guess_within_its_bounds_is_not_certified_where_data_are_unsound(solver: str) -> None:
    p, x = parameter("p", 2), variable("x", 2, lower=-1, upper=1)
    cost = 0.5 * ca.sumsqr(x.symbol - p)
    chain = made(Statement("unsound", [p], [x], cost, requires=[p[0] > p[1]], analytic=p), solver=solver)
    chain.parameters[:] = 0.1, 0.2
    assert chain() == ""
    chain.parameters[:] = 0.2, 0.1
    assert chain()


@settings(max_examples=30)
@given(seeds)
def test_the_last_active_set_changes_no_answer(seed: int) -> None:
    ACTIVE.warm_start(0.0)
    rng, start = np.random.default_rng(seed), random_qp(seed % 10**6, N, 0, unbounded=False)
    who = set()
    for _ in range(6):
        qp = start._replace(g=start.g + rng.normal(scale=0.3, size=N))
        ACTIVE.parameters[:] = parameters_of(qp)
        who.add(ACTIVE())
        np.testing.assert_allclose(ACTIVE.x, solved(qp).x, atol=1e-8)
        assert ACTIVE() == "active set"  # of the same again
    assert who <= {"active set", "dual active set"}


ACTIVE = made(dataclasses.replace(general_statement(N, 0), active_set=True))


# -------------------------------------------------------------------------------------------------------- backup
@pytest.mark.parametrize("failure", FAILURES)
@pytest.mark.parametrize(("primary", "backup"), [("proxqp", "qrqp")])
def test_the_backup_answers_where_the_primary_fails(
    made_to_fail: Callable[[dict[str, Broken]], None], failure: Broken, primary: str, backup: str
) -> None:
    made_to_fail({primary: failure})
    chain = made(solver=primary, backup=backup)
    chain.parameters[:] = 3.0, 0.2
    assert chain() == backup
    assert 0 <= chain.residual[0] <= TOLERANCE
    np.testing.assert_allclose(chain.x, [1.0, 0.2], atol=1e-6)
    assert chain.memory.tolist() == [1]


@pytest.mark.parametrize("failure", FAILURES)
@pytest.mark.parametrize("primary", ["daqp"])
def test_where_both_fail_nobody_answers_and_the_memory_stays(
    made_to_fail: Callable[[dict[str, Broken]], None], failure: Broken, primary: str
) -> None:
    made_to_fail({primary: failure, "proxqp": failure})
    chain = made(solver=primary, backup="proxqp")
    chain.memory[:] = 7.0
    chain.parameters[:] = 3.0, 0.2
    assert chain() == ""
    assert not 0 <= chain.residual[0] <= TOLERANCE
    assert chain.memory.tolist() == [7]
    assert np.isfinite(chain.state).all()


def fused_failing(chain: FallbackChain, times: int, residual: float) -> list[Array]:
    """Make the fused function give a wrong answer that often; returns the states it was started from."""
    real, started = chain.function.evaluate, []

    def evaluate() -> None:
        started.append(chain.state.copy())
        real()
        if len(started) <= times:
            chain.answer[:] = np.full(chain.state.size, 2e9)
            chain.verdict[0] = residual

    chain.function.evaluate = evaluate
    return started


@pytest.mark.parametrize("residual", [np.nan, -1.0])
def test_a_failed_warm_start_is_tried_again_cold_behind_the_backup(
    made_to_fail: Callable[[dict[str, Broken]], None], residual: float
) -> None:
    asked: list[Instance] = []

    def unable(qp: Instance) -> Answer:
        asked.append(qp)
        return garbage(qp)

    made_to_fail({"osqp": unable})
    chain = made(backup="osqp")
    chain.parameters[:] = 3.0, 0.2
    chain()
    assert not asked
    started = fused_failing(chain, 1, residual)
    assert chain() == "qrqp"
    assert len(asked) == 1
    warm, cold = started
    assert warm[:5].any()
    assert not cold[:5].any()
    assert cold[5:].tolist() == warm[5:].tolist() == [1]  # the memory is no warm start
    np.testing.assert_allclose(chain.x, [1.0, 0.2], atol=1e-9)
    assert chain.memory.tolist() == [2]


@pytest.mark.parametrize("residual", [np.nan, 1.0])
def test_the_backup_answers_at_once_where_the_fused_solver_fails(residual: float) -> None:
    chain = made(backup="proxqp")
    chain.parameters[:] = 3.0, 0.2
    started = fused_failing(chain, 1, residual)
    assert chain() == "proxqp"
    assert len(started) == 1
    np.testing.assert_allclose(chain.x, [1.0, 0.2], atol=1e-6)
    assert chain.iterations >= 0
    chain.parameters[:] = 0.4, 0.2
    assert chain() in FUSED_SOLVERS
    np.testing.assert_allclose(chain.x, [0.4, 0.2], atol=1e-9)


# ----------------------------------------------------------------------------------------- unusable parameters
@pytest.fixture(params=SOLVERS)
def used(request: pytest.FixtureRequest) -> Iterator[FallbackChain]:
    chain = made(solver=request.param, backup="osqp" if request.param != "osqp" else "qrqp")
    chain.parameters[:] = 0.1, 0.2
    chain()
    yield chain
    for _ in range(2):  # well again, whatever was tried
        chain.parameters[:] = 3.0, 0.2
        assert chain()
        np.testing.assert_allclose(chain.x, [1.0, 0.2], atol=1e-6)


def test_a_parameter_that_is_no_plausible_number_gives_no_answer(used: FallbackChain) -> None:
    for bad in (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e150, MAX_MAGNITUDE * 1.001, -MAX_MAGNITUDE * 1.001):
        for place in (0, 1):
            used.parameters[:] = 0.1, 0.2
            used.parameters[place] = bad
            assert used() == ""
            assert not 0 <= used.residual[0] <= TOLERANCE
            assert used.memory.tolist() == [1]
            assert np.isfinite(used.state).all()


def test_what_the_statement_requires_is_required(used: FallbackChain) -> None:
    used.parameters[:] = -2.1, 0.0
    assert used() == ""
    assert used.memory.tolist() == [1]
    used.parameters[:] = -2.0, 0.0
    assert used()
    assert used.memory.tolist() == [2]


def test_a_nan_memory_gives_no_answer() -> None:
    p, memory = parameter("p", 1), ca.SX.sym("memory", 1)
    x = variable("x", 1, lower=-1, upper=1)
    statement = Statement("m", [p], [x], 0.5 * ca.sumsqr(x.symbol - p - memory), memory=memory, remember=x.symbol)
    chain = made(statement, backup="proxqp")
    chain.memory[:] = np.nan
    assert chain() == ""
    chain.memory[:] = 0.5
    assert chain()
    assert chain.x[0] == pytest.approx(0.5)


# ----------------------------------------------------------------------------------------------------- arguments
@pytest.mark.parametrize(("solver", "backup"), [("qrqp", "daqp"), ("osqp", "daqp"), ("daqp", "qrqp")])
def test_the_backup_is_another_kind_of_solver_where_none_is_named(solver: str, backup: str) -> None:
    assert FallbackChain(counting(), solver=solver, backup=None, tolerance=TOLERANCE, compile=False).backup == backup


def test_what_cannot_be_used_is_named() -> None:
    usual = {"solver": "qrqp", "backup": "daqp", "tolerance": TOLERANCE, "compile": False}
    rows = [({**usual, "tolerance": each}, "tolerance") for each in (0.0, -1e-6, 1.0, np.nan, np.inf)]
    rows += [({**usual, name: "gurobix"}, name, "gurobix") for name in ("solver", "backup")]
    refuses(partial(FallbackChain, counting()), *rows)
