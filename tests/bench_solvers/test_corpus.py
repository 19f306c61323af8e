"""Claims about the shipped corpus, judged by linear programmes and plain numpy: it is what it says it is."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from bench.qp_recording.sequence import ARRAYS, QPSequence, read_sequence
from bench.solvers import corpus, nlp_corpus
from bench.solvers.marked import MAKERS
from bench.solvers.nlp_instances import read_nlp_instances
from bench.solvers.shipped import families, shipped_nlp_instances, shipped_sequences
from rehab_opt.optim.backends import backend
from rehab_opt.optim.nlp_solvers import nlp_solver
from rehab_opt.optim.rows import Instance

Array = NDArray[np.float64]

SEQUENCES = {name: read_sequence(path) for name, path in shipped_sequences().items()}
NLPS = {name: read_nlp_instances(path) for name, path in shipped_nlp_instances().items()}
SOLVABLE = [name for name, each in SEQUENCES.items() if each.family not in ("infeasible", "badly_scaled")]
SAME = 1e-9
"""Largest difference of a regenerated number, in units of the largest of its array."""


def feasible(qp: Instance) -> bool:
    """Whether some x is within rows and bounds, by HiGHS."""
    matrix, limits = np.vstack([qp.A, -qp.A]), np.concatenate([qp.rows_upper, -qp.rows_lower])
    finite = np.isfinite(limits)
    rows = (matrix[finite], limits[finite]) if finite.any() else (None, None)
    bounds = np.column_stack([qp.lower, qp.upper])
    answer = linprog(np.zeros(qp.g.size), A_ub=rows[0], b_ub=rows[1], bounds=bounds, method="highs")
    assert answer.status in (0, 2), answer.message
    return bool(answer.status == 0)


def kkt_residual(qp: Instance, x: Array, of_bounds: Array, of_rows: Array) -> float:
    """Largest of stationarity, violation and complementarity, by plain numpy; NaN where a number is."""
    rows = qp.A @ x
    parts = [np.abs(qp.H @ x + qp.g + of_bounds + qp.A.T @ of_rows)]
    for value, lower, upper, multiplier in (
        (x, qp.lower, qp.upper, of_bounds), (rows, qp.rows_lower, qp.rows_upper, of_rows),
    ):  # fmt: skip
        parts += [np.maximum(lower - value, 0), np.maximum(value - upper, 0)]
        parts.append(np.minimum(np.maximum(multiplier, 0), np.abs(upper - value)))
        parts.append(np.minimum(np.maximum(-multiplier, 0), np.abs(value - lower)))
    return float(np.max(np.concatenate(parts)))


def sound_ticks(sequence: QPSequence) -> list[int]:
    return [tick for tick in range(len(sequence)) if "nan" not in sequence.marks_of(tick)]


def assert_same_numbers(made: Array, shipped: Array) -> None:
    assert made.shape == shipped.shape
    finite = np.isfinite(shipped)
    np.testing.assert_array_equal(made[~finite], shipped[~finite])
    scale = max(1.0, float(np.abs(shipped[finite]).max(initial=0.0)))
    assert float(np.abs(made[finite] - shipped[finite]).max(initial=0.0)) <= SAME * scale


# ---------------------------------------------------------------------------------------------------------- the files
def test_every_recipe_has_its_file_and_every_file_its_recipe_and_no_family_is_missing() -> None:
    assert sorted(SEQUENCES) == sorted(corpus.names())
    assert sorted(NLPS) == sorted(nlp_corpus.names())
    assert set(families()) == {name.partition("/")[0] for name in SEQUENCES} >= {
        "arm_ik", "ardis", "mirror", "assistance", "field_learning", "pose_tracking",
        "infeasible", "degenerate", "badly_scaled", "nan",
    }  # fmt: skip


@pytest.mark.parametrize("name", SEQUENCES)
def test_a_sequence_says_what_it_is(name: str) -> None:
    sequence = SEQUENCES[name]
    assert sequence.name == name
    assert sequence.command == f"python -m bench.solvers.regenerate {name}"
    assert len(sequence.about) > 20
    assert set(sequence.versions) == {"rehab_opt", "casadi", "numpy"}
    assert 50 <= len(sequence) <= 500
    marks = {mark for tick in range(len(sequence)) for mark in sequence.marks_of(tick)}
    assert marks == ({sequence.family} if name in MAKERS else set())


# --------------------------------------------------------------------------------------------------- what it says it is
@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in SEQUENCES if name.startswith("infeasible/")])
def test_an_infeasible_one_has_no_solution(name: str) -> None:
    assert not any(feasible(qp) for qp in list(SEQUENCES[name])[::5])


@pytest.mark.nightly
@pytest.mark.parametrize("name", SOLVABLE)
def test_every_sound_tick_is_a_convex_qp_whose_solution_is_certified(name: str) -> None:
    sequence = SEQUENCES[name]
    primary, backup = (backend(solver, sequence.n, sequence.m) for solver in ("proxqp", "osqp"))
    for tick in sound_ticks(sequence):
        qp = sequence[tick]
        np.testing.assert_allclose(qp.H, qp.H.T, atol=1e-12 * np.abs(qp.H).max())
        assert np.linalg.eigvalsh(qp.H)[0] >= -1e-12 * np.abs(qp.H).max()
        residual = kkt_residual(qp, *primary.solve(qp)[:3])
        if not residual <= sequence.tolerance:
            residual = kkt_residual(qp, *backup.solve(qp)[:3])
        if not residual <= sequence.tolerance:  # what is allowed is one point to rounding: on from where it gave up
            residual = kkt_residual(qp, *backup.solve(qp)[:3])
        assert residual <= sequence.tolerance, f"tick {tick}"


# ----------------------------------------------------------------------------------------------------------- made again
@pytest.mark.nightly
@pytest.mark.parametrize(
    "name",
    [
        "pose_tracking/free",
        "pose_tracking/limited",
        "assistance/at_bounds",
        "mirror/far",
        "nan/pose_tracking",
        "ardis/differential_doorway",
    ],
)
def test_made_again_it_has_the_same_numbers(name: str) -> None:
    made, shipped = corpus.made(name), SEQUENCES[name]
    for key in ARRAYS:
        assert_same_numbers(getattr(made, key), getattr(shipped, key))
    assert (made.marks, made.tolerance, made.about) == (shipped.marks, shipped.tolerance, shipped.about)


def test_the_command_in_a_file_writes_that_file(tmp_path: Path) -> None:
    command = SEQUENCES["assistance/within_bounds"].command.split()[1:]
    done = subprocess.run(
        [sys.executable, *command, "--out", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    made = read_sequence(tmp_path / "qp" / "assistance" / "within_bounds.npz")
    for key in ARRAYS:
        assert_same_numbers(getattr(made, key), getattr(SEQUENCES["assistance/within_bounds"], key))


# ------------------------------------------------------------------------------------------------- nonlinear programmes
@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name, each in NLPS.items() if each.statement != "mirror_plan"])
def test_a_programme_is_the_library_s_own_and_has_a_certified_answer(name: str) -> None:
    instances = NLPS[name]
    solver = nlp_solver(instances.nlp, "ipopt", tolerance=instances.tolerance)
    for parameters, start in list(zip(instances.parameters, instances.starts, strict=True))[::12]:
        solver.parameters[:] = parameters
        answer = solver.solve(start)
        assert answer.certified
        if instances.statement == "ik_posture":
            assert answer.report[0] < 1e-6  # the hand is at its target
        elif instances.statement == "mirror_window":
            assert answer.report.min() >= instances.arguments["floor"] - 1e-9
        else:
            assert answer.report[0] > 1e-6  # the target is out of reach
    assert len(instances) >= 49


@pytest.mark.parametrize("name", [name for name, each in NLPS.items() if each.statement == "mirror_plan"])
def test_a_plan_is_run_to_its_end(name: str) -> None:
    path = NLPS[name].plan()
    assert path.complete
    assert path.manipulability.min() >= 0.3 - 1e-9


@pytest.mark.nightly
def test_programmes_made_again_are_the_same() -> None:
    made, shipped = nlp_corpus.made("boundary/restricted"), NLPS["boundary/restricted"]
    for key in ("parameters", "starts"):
        assert_same_numbers(getattr(made, key), getattr(shipped, key))
    assert made.command == shipped.command == "python -m bench.solvers.regenerate nlp/boundary/restricted"
