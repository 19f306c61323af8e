"""daqp answers what is degenerate, badly scaled or flat as it answers anything else, and says no at once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.solvers.dense_qp import Certificate
from rehab_opt.optim.backends import DAQP_OPTIONS, DaqpBackend
from rehab_opt.optim.rows import Instance
from tests.optim.random_qps import Array, random_qp, seeds, solved

N, M = 5, 3
CERTIFICATE, TWICE = Certificate(N, M), Certificate(N, 2 * M)


def in_units(qp: Instance, units: Array) -> Instance:
    """The same QP over y with x = units y."""
    return qp._replace(
        H=qp.H * np.outer(units, units), g=qp.g * units, A=qp.A * units, lower=qp.lower / units, upper=qp.upper / units
    )


@settings(max_examples=60)
@given(seeds, st.floats(0.0, 5.0))
def test_units_change_no_answer(seed: int, orders: float) -> None:
    qp = random_qp(seed, N, M)
    units = 10.0 ** (orders * np.random.default_rng(seed).uniform(-1, 1, N))
    answer = DaqpBackend(N, M).solve(in_units(qp, units))
    plain = answer._replace(x=answer.x * units, bound_multipliers=answer.bound_multipliers / units)
    assert CERTIFICATE.residual(qp, plain) <= 1e-7
    np.testing.assert_allclose(plain.x, solved(qp).x, atol=1e-7)


@settings(max_examples=60)
@given(seeds)
def test_rows_that_stand_twice_change_no_answer(seed: int) -> None:
    qp = random_qp(seed, N, M)
    twice = qp._replace(
        A=np.vstack([qp.A, qp.A]), rows_lower=np.tile(qp.rows_lower, 2), rows_upper=np.tile(qp.rows_upper, 2)
    )
    answer = DaqpBackend(N, 2 * M).solve(twice)
    assert TWICE.residual(twice, answer) <= 1e-7
    np.testing.assert_allclose(answer.x, solved(qp).x, atol=1e-7)


def test_it_is_no_answer_where_the_cap_on_iterations_is_met(monkeypatch: pytest.MonkeyPatch) -> None:
    qp = random_qp(3, N, M)
    assert np.isfinite(DaqpBackend(N, M).solve(qp).x).all()
    monkeypatch.setitem(DAQP_OPTIONS, "iter_limit", 1)
    assert np.isnan(DaqpBackend(N, M).solve(qp).x).all()


def test_matrices_that_are_views_of_others_are_read_as_they_are() -> None:
    qp = random_qp(5, N, M)
    rows = np.asfortranarray(qp.A)
    padded = np.zeros((2 * N, 2 * N))
    padded[::2, ::2] = qp.H
    seen = qp._replace(A=rows, H=padded[::2, ::2], g=np.repeat(qp.g, 2)[::2])
    np.testing.assert_array_equal(DaqpBackend(N, M).solve(seen).x, DaqpBackend(N, M).solve(qp).x)
