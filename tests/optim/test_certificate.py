"""A certificate passes solutions, and nothing else."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rehab_opt.optim.certificate import certificate_function, is_certified
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import BufferedFunction, compiled
from tests.optim.random_qps import Array, Solution, random_qp, seeds, sizes, solved

TOLERANCE = 1e-6
N, M = 3, 2
INPUTS = ("H", "g", "A", "rows_lower", "rows_upper", "lower", "upper", "valid", "x", "y_x", "y_A")

Certify = Callable[..., tuple[Array, float]]


def certificate(n: int, m: int, *, compile: bool = False) -> Certify:
    function = BufferedFunction(compiled(certificate_function(n, m), compile=compile))

    def certify(qp: Instance, claim: Solution, valid: float = 1.0) -> tuple[Array, float]:
        for target, value in zip(function.inputs, [*qp, valid, *claim], strict=True):
            target[...] = np.reshape(value, target.shape)
        function()
        return function.outputs[0].copy(), float(function.outputs[1][0])

    return certify


CERTIFICATES = {(n, m): certificate(n, m) for n in range(1, 8) for m in range(6)}


@pytest.fixture(scope="module")
def both() -> list[Certify]:
    """In the virtual machine and in machine code: a compiler may not do away with what catches NaN."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REHAB_OPT_COMPILE", "wait")
        patch.delenv("REHAB_OPT_OPTIMISE", raising=False)
        return [CERTIFICATES[N, M], certificate(N, M, compile="wait")]


def residual_by_definition(qp: Instance, claim: Solution) -> float:
    """Plain numpy: stationarity, violation, and the smaller of multiplier and slack."""
    x = np.clip(claim.x, qp.lower, qp.upper)
    rows = qp.A @ x
    parts = [qp.H @ x + qp.g + claim.bounds + qp.A.T @ claim.rows]
    parts += [np.maximum(qp.rows_lower - rows, 0), np.maximum(rows - qp.rows_upper, 0)]
    for y, value, low, high in (
        (claim.bounds, x, qp.lower, qp.upper),
        (claim.rows, rows, qp.rows_lower, qp.rows_upper),
    ):
        parts.append(np.where(y > 0, np.minimum(np.abs(y), np.maximum(high - value, 0)), 0))
        parts.append(np.where(y < 0, np.minimum(np.abs(y), np.maximum(value - low, 0)), 0))
    return float(np.linalg.norm(np.concatenate(parts)))


# ------------------------------------------------------------------------------------------------- what passes
@settings(max_examples=60)
@given(seeds, sizes)
def test_a_solution_passes(seed: int, size: tuple[int, int]) -> None:
    qp = random_qp(seed, *size)
    truth = solved(qp)
    x, residual = CERTIFICATES[size](qp, truth)
    assert is_certified(residual, 1e-8)
    np.testing.assert_allclose(x, truth.x, atol=1e-12)
    assert np.all((qp.lower <= x) & (x <= qp.upper))  # exactly, since it is clipped


@settings(max_examples=100)
@given(seeds, sizes)
def test_the_residual_is_that_of_the_definition(seed: int, size: tuple[int, int]) -> None:
    qp, rng = random_qp(seed, *size), np.random.default_rng(seed)
    claim = Solution(*(rng.normal(scale=2, size=k) for k in (size[0], size[0], size[1])))
    expected = residual_by_definition(qp, claim)
    assert CERTIFICATES[size](qp, claim)[1] == pytest.approx(expected, rel=1e-10)


def test_infinite_bounds_need_no_special_case(both: list[Certify]) -> None:
    free = Instance(
        np.eye(N), -np.ones(N), np.ones((M, N)), np.full(M, -np.inf), np.full(M, np.inf), np.full(N, -np.inf),
        np.full(N, np.inf),
    )  # fmt: skip
    for certify in both:
        assert certify(free, Solution(np.ones(N), np.zeros(N), np.zeros(M)))[1] == 0.0
        assert not is_certified(certify(free, Solution(np.ones(N), np.full(N, 1e-3), np.zeros(M)))[1], TOLERANCE)


# ------------------------------------------------------------------------------------------ what does not pass
@settings(max_examples=100)
@given(seeds, sizes)
def test_a_point_beside_the_solution_fails(seed: int, size: tuple[int, int]) -> None:
    qp, rng = random_qp(seed, *size), np.random.default_rng(seed)
    truth = solved(qp)
    beside = np.clip(truth.x + rng.normal(scale=1e-3, size=size[0]), qp.lower, qp.upper)
    distance = np.linalg.norm(beside - truth.x)
    assume(distance > 1e-4)
    assert CERTIFICATES[size](qp, truth._replace(x=beside))[1] >= 0.99 * distance  # H is at least the identity


@settings(max_examples=50)
@given(seeds, st.floats(1e-9, 10))
def test_crossed_bounds_never_pass(seed: int, gap: float) -> None:
    qp, rng = random_qp(seed, N, M, unbounded=False), np.random.default_rng(seed)
    truth = solved(qp)
    i, j = rng.integers(N), rng.integers(M)
    lower, rows_lower = qp.lower.copy(), qp.rows_lower.copy()
    lower[i] = qp.upper[i] + gap
    rows_lower[j] = qp.rows_upper[j] + gap
    for crossed in (qp._replace(lower=lower), qp._replace(rows_lower=rows_lower)):
        for x in (truth.x, lower, qp.upper):
            assert not is_certified(CERTIFICATES[N, M](crossed, truth._replace(x=x))[1], TOLERANCE)


def at_its_lower_bounds() -> tuple[Instance, Solution]:
    """A solution that NaN would be clipped to, with rows that do not matter."""
    lines, zeros = np.ones(M), np.zeros(N)
    qp = Instance(np.eye(N), np.ones(N), np.zeros((M, N)), -lines, lines, zeros, np.ones(N))
    return qp, Solution(zeros, -np.ones(N), np.zeros(M))


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_number_that_is_none_is_never_certified(both: list[Certify], name: str, bad: float) -> None:
    if (bad, name) in {
        (np.inf, "upper"), (np.inf, "rows_upper"), (np.inf, "valid"), (-np.inf, "lower"), (-np.inf, "rows_lower"),
    }:  # fmt: skip
        return  # no bound, and a way to say yes
    cases = [at_its_lower_bounds()]
    cases += [(qp, solved(qp)) for qp in (random_qp(seed, N, M) for seed in range(8))]
    for qp, truth in cases:
        for place in range(np.size([*qp, 1.0, *truth][INPUTS.index(name)])):
            parts = [np.array(part, dtype=np.float64) for part in (*qp, 1.0, *truth)]
            parts[INPUTS.index(name)].reshape(-1)[place] = bad
            for certify in both:
                residual = certify(Instance(*parts[:7]), Solution(*parts[8:]), float(parts[7]))[1]
                assert not is_certified(residual, TOLERANCE)


@settings(max_examples=100)
@given(st.integers(0, 2 ** len(INPUTS) - 2), seeds)
def test_nan_in_several_places_is_never_certified(both: list[Certify], hit: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    qp, truth = at_its_lower_bounds()
    parts = [np.array(part, dtype=np.float64) for part in (*qp, 1.0, *truth)]
    for i, part in enumerate(parts):
        if (hit + 1) >> i & 1:
            part.reshape(-1)[rng.integers(part.size)] = np.nan
    for certify in both:
        residual = certify(Instance(*parts[:7]), Solution(*parts[8:]), float(parts[7]))[1]
        assert not is_certified(residual, TOLERANCE)


@given(seeds, st.sampled_from([0.0, -1.0]))
@settings(max_examples=10)
def test_unsound_data_are_never_certified(seed: int, valid: float) -> None:
    qp = random_qp(seed, N, M)
    assert not is_certified(CERTIFICATES[N, M](qp, solved(qp), valid)[1], TOLERANCE)


@pytest.mark.parametrize("residual", [np.nan, np.inf, -np.inf, -1e-12, 1.1e-6])
def test_a_residual_that_is_no_small_number_is_not_accepted(residual: float) -> None:
    assert not is_certified(residual, TOLERANCE)


@pytest.mark.parametrize("residual", [0.0, 1e-300, 1e-6])
def test_a_residual_up_to_the_tolerance_is_accepted(residual: float) -> None:
    assert is_certified(residual, TOLERANCE)
