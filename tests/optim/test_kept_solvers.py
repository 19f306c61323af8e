"""What the functions, solvers and certificates of QPs and NLPs give on seeded problems is what is kept."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt.optim.backends import QpsolversBackend, backend, has_finite_data, to_qpsolvers
from rehab_opt.optim.certificate import certificate_function, delivered_fraction, first_true, screened_analytic
from rehab_opt.optim.dual_active_set import active_set_round, dual_active_set, picked
from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.nlp import NLP, convexified, model
from rehab_opt.optim.nlp_solvers import nlp_solver
from rehab_opt.optim.nlp_sqp import step_function, subproblem_function
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.recorder import recording_qps
from rehab_opt.optim.rows import Row, equal, parameter, variable, within
from rehab_opt.symbolic.matrices import symmetric
from tests.golden import assert_kept
from tests.golden.functions import assert_functions_kept, digest, watched
from tests.optim.random_qps import general_statement, parameters_of, random_qp

N, M = 4, 5


def equalities(*, guess: bool) -> Statement:
    """Two equalities, rows and bounds, some of them constant; with a memory, a report, and a guess by parameters."""
    p, memory, x = parameter("p", 8), parameter("memory", 2), variable("x", N, lower=-1.0, upper=[1.0, 2.0, ca.inf, 0.5])
    u = x.symbol
    cost = ca.sumsqr(u - p[:4]) + 0.3 * u[0] * u[1] + 0.01 * ca.sumsqr(u[:2] - memory)
    rows = [equal(u[0] + u[1], 0.3 * p[4] + u[2]), within(u[1] - 2 * u[3], -1.0, p[5]), within(u[0] - u[2], -ca.inf, 0.8)]
    return Statement(
        "equalities", [p], [x], cost, rows, active_set=True, requires=[p[6] > 0], report=ca.vertcat(u[0] * p[7], cost),
        analytic=p[:4] if guess else None, dual=ca.vertcat(p[4], 0, ca.fmax(p[5], 0)) if guess else None,
        memory=memory, remember=ca.vertcat(u[1], p[6]), violation=ca.fmax(u[3] - p[7], 0),
    )  # fmt: skip


def programme() -> NLP:
    p, x = parameter("p", 2), variable("x", 3, lower=[-2, -2, -1], upper=[2, ca.inf, 1])
    a, b, c = ca.vertsplit(x.symbol)
    cost = (1 - a) ** 2 + p[0] * (b - a**2) ** 2 + ca.cos(c) * a
    rows = [within(a**2 + b**2 + c, -ca.inf, 1.5), within(a * b, p[1], 4), equal(c - a * b, 0.1)]
    return NLP("programme", [p], [x], cost, rows, report=ca.vertcat(c, a * b))


def function_of(name: str, expression: Any, *symbols: ca.SX) -> ca.Function:
    outputs = expression if isinstance(expression, (tuple, list)) else [expression]
    return ca.Function(name, list(symbols), [ca.densify(ca.SX(each)) for each in outputs])


def expressions() -> list[ca.Function]:
    """Those of single parts."""
    upper = ca.SX.sym("triangle", 10)
    x, y, p, flag = ca.SX.sym("x", 3), ca.SX.sym("y", 3), ca.SX.sym("p", 9), ca.SX.sym("flag", 5)
    rows = Row(ca.vertcat(x[0] - x[1], x[2], x[0]), ca.vertcat(-ca.inf, p[6], -1), ca.vertcat(p[7], p[6] + 1, ca.inf))
    problem = {"cost": ca.sumsqr(x - p[:3]), "x": x, "rows": rows, "bounds": (ca.SX([-1, -ca.inf, 0]), ca.SX([1, 2, ca.inf])), "valid": p[8] > 0}  # fmt: skip
    nlp, made = programme(), [
        function_of("convexified", convexified(symmetric(upper, 4)), upper),
        function_of("picked", picked(flag > 0, 3), flag),
        function_of("first", first_true(flag > 0), flag),
        function_of("delivered", [delivered_fraction(x, y, p[0] > 0, least=0.1), delivered_fraction(x, y, p[0] > 0, least=0.1, enough=0.5)], x, y, p),
        function_of("screened", screened_analytic(p[3:6], None, **problem), x, p),
        function_of("screened_dual", screened_analytic(p[3:6], y, **problem), x, y, p),
        function_of("screened_nothing", screened_analytic(None, None, **problem), x, p),
    ]  # fmt: skip
    multipliers = ca.SX.sym("multipliers", 6)
    made += [function_of("model", model(nlp, multipliers), nlp.p, nlp.x, multipliers)]
    return [*made, step_function(nlp), subproblem_function(nlp), nlp.bounds, nlp.certify, certificate_function(3, 2), certificate_function(2, 0)]


def cases(count: int, n: int = N, m: int = M) -> list[Any]:
    return [random_qp(seed, n, m, unbounded=False) for seed in range(count)]


def test_functions_are_those_kept() -> None:
    rng = np.random.RandomState(0)
    with watched() as met:
        chains = [FallbackChain(equalities(guess=guess), solver=solver, backup=None, tolerance=1e-8, compile=False)
                  for guess, solver in ((True, "qrqp"), (False, "qrqp"), (True, "daqp"))]  # fmt: skip
        said = []
        for chain in chains:
            for k in range(60):
                chain.parameters[:] = rng.normal(size=8) * (0.3 if k % 3 else 1.0)
                chain.parameters[6] = 1.0 if k % 10 else -1.0
                chain.parameters[4 + k % 4] = math.nan if k == 33 else chain.parameters[4 + k % 4]
                if k % 20 == 19:
                    chain.forget(0.1)
                who = chain()
                said.append(([*chain.x, *chain.memory, *chain.report, *chain.state[N:]] if who else [], who))
    dual = general_statement(N, M).form()[0], equalities(guess=False).form()[0]
    for form in dual:
        for function in (dual_active_set(form), *(active_set_round(form, together=k, passes=k) for k in (0, 1, 3))):
            met.functions.append((function, []))
            numbers = form.build.numel_in(0)
            given = [general_statement(N, M).form()[1](parameters_of(qp), []).full().ravel() for qp in cases(40)] if form is dual[0] else [
                0.5 * rng.normal(size=numbers) for _ in range(40)]  # fmt: skip
            met.functions[-1][1].extend([each, *([np.sign(rng.randint(-3, 4, N + form.m) / 2.5)] if function.n_in() > 1 else [])] for each in given)
            met.functions += [(inner, [drawn(inner, rng) for _ in range(40)]) for inner in function.find_functions(3) if inner.name() in {"dual_first", "dual_step"}]
    met.functions += [(each, [drawn(each, rng) for _ in range(40)]) for each in expressions()]
    assert_functions_kept("optim_functions", met, said, samples=200)


def drawn(function: ca.Function, rng: np.random.RandomState) -> list[np.ndarray]:
    """Inputs of the size of one, some of them nothing, or flags."""
    found = []
    for i in range(function.n_in()):
        values = rng.normal(size=function.size_in(i)) * rng.choice([1.0, 1.0, 0.2, 0.0], size=function.size_in(i))
        found.append(values[:, 0] if values.shape[1] == 1 else np.where(rng.uniform() < 0.2, np.sign(values), values))
    return found


def answers(made: Any) -> list[Any]:
    """Of a solver, one problem after the other: scaled, with rows twice, hopeless, concave, without a number."""
    told: list[Any] = []
    for k, qp in enumerate(cases(14)):
        units = 10.0 ** (3.0 * np.sin(np.arange(N)) * (k % 3 == 2))
        qp = qp._replace(H=qp.H * np.outer(units, units), g=qp.g * units, A=qp.A * units, lower=qp.lower / units, upper=qp.upper / units)  # fmt: skip
        if k in (3, 9):
            qp = qp._replace(rows_lower=np.where(np.arange(M) == 1, 50.0, qp.rows_lower), rows_upper=np.where(np.arange(M) == 1, 51.0, qp.rows_upper))
        if k == 5:
            qp = qp._replace(H=qp.H * math.nan)
        if k == 7:
            qp = qp._replace(A=np.vstack([qp.A[:1], qp.A[:1], qp.A[2:]]), rows_lower=np.r_[qp.rows_lower[:1], qp.rows_lower[:1], qp.rows_lower[2:]], rows_upper=np.r_[qp.rows_upper[:1], qp.rows_upper[:1], qp.rows_upper[2:]])
        if k == 11:
            made.forget()
        answer = made.solve(qp)
        stationary = qp.H @ answer.x + qp.g + answer.bound_multipliers + qp.A.T @ answer.row_multipliers
        told.append([bool(has_finite_data(qp)), *np.round(np.nan_to_num(np.r_[units * answer.x, stationary], nan=9.0), 5), bool(np.isfinite(answer.x).all())])
    return told


@pytest.mark.parametrize("name", ["daqp", "proxqp", "osqp", "qpsolvers"])
def test_solvers_answer_as_was_kept(name: str) -> None:
    made = QpsolversBackend("daqp") if name == "qpsolvers" else backend(name, N, M)
    problems = [digest(*(each for each in vars(to_qpsolvers(qp)).values() if isinstance(each, np.ndarray))) for qp in cases(4)]
    assert_kept(f"optim_{name}", {"answers": answers(made), "problems": problems}, relative=0.0, absolute=2e-5)


@pytest.mark.parametrize("name", ["sqp", "ipopt", "fatrop", "sqpmethod"])
def test_programmes_are_solved_as_was_kept(name: str) -> None:
    with recording_qps(skip=1, most=2) as recorder:
        solver = nlp_solver(programme(), name, compile=False)
    told: list[Any] = []
    for steepness, least in ((1.0, -1.0), (5.0, 0.2), (2.0, 9.0), (math.nan, 0.0), (1e12, 0.0)):
        for start in ([0.5, 0.5, 0.1], [-1.0, 0.3, 0.0], [math.inf, 0.0, 0.0]):
            solver.parameters[:] = steepness, least
            answer = solver.solve(start)
            told.append([answer.certified, answer.solver, *(np.round([*answer.x, *answer.multipliers, answer.cost, *answer.report], 5) if answer.certified else [])])
    seen = [[len(stream), *(digest(*instance) for instance in stream.instances()[:2])] for stream in recorder.streams]
    assert_kept(f"optim_{name}", {"answers": told, "seen": seen}, relative=0.0, absolute=3e-5)
