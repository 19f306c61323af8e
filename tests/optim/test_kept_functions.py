"""What the functions and certificates of QPs and NLPs give on seeded problems is what is kept."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from rehab_opt.optim.certificate import certificate_function, delivered_fraction, first_true, screened_analytic
from rehab_opt.optim.dual_active_set import active_set_round, dual_active_set, picked
from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.nlp import NLP, convexified, model
from rehab_opt.optim.nlp_sqp import step_function, subproblem_function
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import Row, equal, parameter, variable, within
from tests.golden.functions import assert_functions_kept, drawn, watched
from tests.optim.random_qps import general_statement, parameters_of, random_qp

N, M = 4, 5


def equalities(*, guess: bool) -> Statement:
    """An equality, rows and bounds, some of them constant; with a memory, a report, and a guess by parameters."""
    p, memory, x = parameter("p", 8), parameter("memory", 2), variable("x", N, lower=-1.0, upper=[1, 2, ca.inf, 0.5])
    u = x.symbol
    cost = ca.sumsqr(u - p[:4]) + 0.3 * u[0] * u[1] + 0.01 * ca.sumsqr(u[:2] - memory)
    rows = [equal(u[0] + u[1], 0.3 * p[4] + u[2]), within(u[1] - 2 * u[3], -1.0, p[5]), within(u[0], -ca.inf, 0.8)]
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


def parts() -> list[ca.Function]:
    """Functions of single parts."""
    matrix, x, y, p, flag = (ca.SX.sym("s", *size) for size in ((4, 4), (3, 1), (3, 1), (9, 1), (5, 1)))
    rows = Row(ca.vertcat(x[0] - x[1], x[2], x[0]), ca.vertcat(-ca.inf, p[6], -1), ca.vertcat(p[7], p[6] + 1, ca.inf))
    bounds = ca.SX([-1, -ca.inf, 0]), ca.SX([1, 2, ca.inf])
    guesses = [screened_analytic(*guess, cost=ca.sumsqr(x - p[:3]), x=x, rows=rows, bounds=bounds, valid=p[8] > 0)
               for guess in ((p[3:6], None), (p[3:6], y), (None, None))]  # fmt: skip
    shares = [delivered_fraction(x, y, p[0] > 0, least=0.1, enough=enough) for enough in (1e-3, 0.5)]
    every = [convexified(matrix + matrix.T), picked(flag > 0, 3), first_true(flag > 0), *shares, *sum(guesses, ())]
    whole = ca.Function("parts", [matrix, x, y, p, flag], [ca.densify(ca.SX(each)) for each in every])
    multipliers, nlp, form = ca.SX.sym("multipliers", 6), programme(), equalities(guess=False).form()[0]
    modelled = ca.Function("model", [nlp.p, nlp.x, multipliers], [*model(nlp, multipliers)])
    rounds = [active_set_round(form, together=k, passes=k) for k in (0, 1, 3)]
    certificates = certificate_function(3, 2), certificate_function(2, 0), nlp.certify
    return [
        whole,
        modelled,
        dual_active_set(form),
        *rounds,
        *certificates,
        step_function(nlp),
        subproblem_function(nlp),
    ]


def test_functions_are_those_kept() -> None:
    rng, said = np.random.RandomState(0), list[Any]()
    with watched() as met:
        for guess, solver in ((True, "qrqp"), (False, "qrqp"), (True, "daqp")):
            chain = FallbackChain(equalities(guess=guess), solver=solver, backup=None, tolerance=1e-8, compile=False)
            for k in range(60):
                chain.parameters[:] = rng.normal(size=8) * (0.3 if k % 3 else 1.0)
                chain.parameters[6] = 1.0 if k % 10 else -1.0
                chain.parameters[4 + k % 4] *= math.nan if k == 33 else 1.0
                if k % 20 == 19:
                    chain.forget(0.1)
                who = chain()
                said.append((who, *([chain.x, chain.memory, chain.report, chain.state[N:]] if who else [])))
    general = general_statement(N, M).form()
    numbers = [general[1](parameters_of(random_qp(k, N, M, unbounded=False)), []).full()[:, 0] for k in range(40)]
    met.functions.append((dual_active_set(general[0]), [[each] for each in numbers]))
    met.functions += [(each, [drawn(each, k) for k in range(40)]) for each in parts()]
    assert_functions_kept("optim_functions", met, *said, samples=160)
