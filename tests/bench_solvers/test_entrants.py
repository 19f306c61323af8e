"""Each installed solver answers ordinary QPs, and its answer reaches our certificate in our terms."""

from __future__ import annotations

import numpy as np
import pytest

from bench.qp_recording.sequence import QPSequence, sequence_of
from bench.solvers.dense_qp import Certificate, DenseQP
from bench.solvers.entrant import Entrant
from bench.solvers.entrants import entrants
from bench.solvers.instances import RecordedQPs
from rehab_opt.optim.rows import Instance

INFINITE = np.inf


def mixed(ticks: int = 8) -> QPSequence:
    """An equality, a two-sided and a one-sided row; bounds of which some are absent."""
    random = np.random.default_rng(3)
    rows = random.normal(size=(3, 4))
    instances = []
    for tick in range(ticks):
        gradient = np.array([1.0, -2.0, 0.5, 1.5]) + 0.2 * np.sin(0.3 * tick + np.arange(4))
        instances.append(
            Instance(
                np.diag([1.0, 2.0, 3.0, 4.0]) + 0.1, gradient, rows,
                np.array([0.1, -0.2, -INFINITE]), np.array([0.1, 0.2, 0.3]),
                np.array([-0.3, -INFINITE, -1.0, -0.2]), np.array([INFINITE, 0.4, 1.0, INFINITE]),
            )
        )  # fmt: skip
    return sequence_of("mixed/small", instances, dt=0.01, tolerance=1e-5, command="a test", about="mixed bounds")


@pytest.mark.filterwarnings("ignore")  # solvers warn of what they are given
@pytest.mark.parametrize("who", [each for each in entrants() if each.kind == "qp"], ids=lambda who: who.name)
@pytest.mark.parametrize("warm", [False, True], ids=["cold", "warm"])
def test_every_installed_solver_is_certified_on_equalities_rows_and_absent_bounds(who: Entrant, warm: bool) -> None:
    sequence = mixed()
    solver, certificate = who.make(RecordedQPs(sequence), who.solver), Certificate(sequence.n, sequence.m)
    for qp in sequence:
        claim = solver.claim(qp, solver.solve(solver.prepared(qp), warm=warm))
        assert claim.word, claim.said
        assert certificate.residual(qp, claim.answer) <= 1e-5


def test_the_fused_way_says_no_to_what_has_no_answer_and_recovers() -> None:
    sequence = mixed()
    solver = DenseQP(sequence.n, sequence.m, compile=False)
    good = solver.flat(sequence[0])
    apart = sequence[0]._replace(lower=np.full(4, 1.0), upper=np.full(4, -1.0))
    unknown = sequence[0]._replace(g=np.full(4, np.nan))
    contrary = sequence[0]._replace(lower=np.full(4, 5.0), upper=np.full(4, 6.0))
    for bad in (apart, unknown, contrary):
        assert not solver.solve(solver.flat(bad), warm=True)[1] <= 1.0
        assert solver.solve(good, warm=True)[1] <= 1e-9
