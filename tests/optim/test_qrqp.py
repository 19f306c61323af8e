"""qrqp writes one integer past its work space when every multiplier changes sign at once: it is given more room."""

import ctypes
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings

from rehab_opt.optim.qrqp import QRQP_ITERATIONS, SPARE, qrqp, qrqp_options
from rehab_opt.symbolic.compiled import FLAGS, _compiler
from tests.optim.random_qps import Array, random_qp, seeds

SIZES = [(1, 1), (3, 2), (7, 3)]
NAMES = ("h", "g", "a", "lba", "uba", "lbx", "ubx", "x0", "lam_x0", "lam_a0")
CANARY = 0x5AFE


def bare(n: int, m: int) -> ca.Function:
    shape = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    return ca.conic("bare", "qrqp", shape, qrqp_options())


def flipping(seed: int, n: int, m: int) -> dict[str, Array]:
    """A QP with equality rows, started from multipliers of any sign and size at the bounds they speak for.

    With one variable and one row, one in a hundred makes both multipliers change sign within one step.
    """
    rng = np.random.default_rng(seed)
    root, matrix, inside = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
    lower, upper, kept = inside - rng.exponential(size=n), inside + rng.exponential(size=n), matrix @ inside
    size = 10 ** rng.uniform(-3, 1)
    of_bounds = size * rng.choice([-1, 1], n) * rng.exponential(size=n)
    of_rows = size * rng.choice([-1, 1], m) * rng.exponential(size=m)
    return {
        "h": root @ root.T + 0.1 * np.eye(n), "g": 3 * rng.normal(size=n), "a": matrix, "lba": kept, "uba": kept,
        "lbx": lower, "ubx": upper, "x0": inside if rng.random() < 0.5 else np.where(of_bounds > 0, upper, lower),
        "lam_x0": of_bounds, "lam_a0": of_rows,
    }  # fmt: skip


# -------------------------------------------------------------------------------------------------------- claims
@pytest.mark.parametrize(("n", "m"), [*SIZES, (1, 0), (4, 0), (1, 3)])
def test_the_work_space_is_larger_than_the_bare_solver_s(n: int, m: int) -> None:
    assert qrqp("roomy", n, m).sz_iw() >= bare(n, m).sz_iw() + SPARE
    assert SPARE >= 1


PAIR = (qrqp("roomy", 4, 2), bare(4, 2))


@settings(max_examples=100)
@given(seeds)
def test_no_answer_changes(seed: int) -> None:
    qp = random_qp(seed, 4, 2)
    data = dict(zip(NAMES[:7], (qp.H, qp.g, qp.A, qp.rows_lower, qp.rows_upper, qp.lower, qp.upper), strict=True))
    ours, theirs = (solve(**data) for solve in PAIR)
    for name, value in theirs.items():
        np.testing.assert_array_equal(np.array(ours[name]), np.array(value))


def test_it_is_capped_and_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    assert qrqp_options()["max_iter"] == QRQP_ITERATIONS <= 1000
    qrqp("quiet", 3, 2)(**flipping(0, 3, 2))
    assert capfd.readouterr() == ("", "")


# ------------------------------------------------------------------------------------------ what it is there for
def written_past(function: ca.Function, folder: Path, n: int, m: int, count: int) -> int:
    """How many of `count` QPs write behind the integer work space that the compiled function asks for."""
    compiler = _compiler()
    if compiler is None:
        pytest.skip("no C compiler on this machine")
    name = function.name()
    generator = ca.CodeGenerator(name)
    generator.add(function)
    code, library = folder / f"{name}.c", folder / f"{name}.so"
    code.write_text(generator.dump())
    subprocess.run([compiler[0], *FLAGS, "-O1", str(code), "-o", str(library), "-lm"], check=True, capture_output=True)
    call = getattr(ctypes.CDLL(str(library)), name)
    doubles, integers = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_longlong)
    arguments, results = (doubles * (function.sz_arg() + 8))(), (doubles * (function.sz_res() + 8))()
    room, spare = function.sz_iw(), 8
    w = np.zeros(function.sz_w() + 64)
    outputs = [np.zeros(function.nnz_out(i) + 1) for i in range(function.n_out())]
    hurt = 0
    for seed in range(count):
        data = flipping(seed, n, m)
        inputs = [
            np.asfortranarray(data.get(name, np.zeros(function.size_in(i)))).ravel("F").astype(float)
            for i, name in enumerate(function.name_in())
        ]
        iw = np.zeros(room + spare, dtype=np.int64)
        iw[room:] = CANARY
        for i, array in enumerate(inputs):
            arguments[i] = array.ctypes.data_as(doubles)
        for i, array in enumerate(outputs):
            results[i] = array.ctypes.data_as(doubles)
        call(arguments, results, iw.ctypes.data_as(integers), w.ctypes.data_as(doubles), 0)
        hurt += bool(np.any(iw[room:] != CANARY))
    return hurt


@pytest.mark.parametrize(("n", "m"), SIZES[1:2])
def test_nothing_is_written_behind_the_work_space(tmp_path: Path, n: int, m: int) -> None:
    assert written_past(qrqp("roomy", n, m), tmp_path, n, m, 2000) == 0


def test_the_bare_solver_still_needs_the_room(tmp_path: Path) -> None:
    """When this fails, casadi has been repaired and the room may go."""
    assert written_past(bare(1, 1), tmp_path, 1, 1, 2000) > 0
