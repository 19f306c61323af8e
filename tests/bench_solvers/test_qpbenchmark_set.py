"""Claims about the corpus inside qpbenchmark, which runs it here itself."""

import math
from pathlib import Path

import numpy as np
import pytest

from bench.qp_recording.sequence import read_sequence
from bench.solvers.qpbenchmark_set import corpus_test_set
from bench.solvers.shipped import shipped_sequences

SOLVERS = ("proxqp", "daqp")


@pytest.fixture(scope="module")
def qpbenchmark() -> object:
    return pytest.importorskip("qpbenchmark", reason="the comparison with qpbenchmark needs it installed")


@pytest.mark.filterwarnings("ignore")  # its own of pandas, and qpsolvers' of conversions
@pytest.mark.usefixtures("qpbenchmark")
def test_qpbenchmark_runs_a_few_of_it_and_finds_them_solved(tmp_path: Path) -> None:
    from qpbenchmark.results import Results  # noqa: PLC0415
    from qpbenchmark.run import run  # noqa: PLC0415

    test_set = corpus_test_set(families=["ardis", "pose_tracking"], every=50)
    test_set.solvers = set(test_set.solvers) & set(SOLVERS)
    assert test_set.solvers
    results = Results(tmp_path / "results.csv", test_set)
    run(test_set, results, only_settings="high_accuracy", verbose=True)
    frame = results.df
    assert len(frame) == test_set.count_problems() * len(test_set.solvers) > 50
    assert frame["found"].all()
    for measure in ("primal_residual", "dual_residual"):
        assert (frame[measure] < 1e-7).all()
    assert (tmp_path / "results.csv").exists()


@pytest.mark.usefixtures("qpbenchmark")
def test_its_problems_are_the_sequences_own() -> None:
    (problem, *_), sequence = corpus_test_set(families=["mirror"]), read_sequence(shipped_sequences()["mirror/far"])
    qp = sequence[0]
    assert problem.name == "mirror/far#0"
    np.testing.assert_array_equal(problem.P, qp.H)
    np.testing.assert_array_equal(problem.q, qp.g)
    # The same feasible set: rows with an upper bound alone stay as they are.
    assert (qp.rows_lower == -math.inf).all()
    np.testing.assert_array_equal(problem.G, qp.A)
