"""QPs larger than any controller's here: compared by whoever can, in seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.solvers.dense_qp import LARGEST, DenseQP
from bench.solvers.entrants import entrants_named
from bench.solvers.instances import RecordedQPs
from bench.solvers.passes import Rules
from bench.solvers.run import compare
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.rows import Instance
from rehab_opt.qp_recording.sequence import QPSequence, sequence_of


def large(n: int, m: int) -> QPSequence:
    random = np.random.default_rng(0)
    root, rows = random.normal(size=(n, n)), random.normal(size=(m, n))
    instances = [
        Instance(root @ root.T / n + np.eye(n), random.normal(size=n), rows, -np.ones(m), np.ones(m),
                 np.full(n, -0.1), np.full(n, 0.1))
        for _ in range(3)
    ]  # fmt: skip
    return sequence_of("large/one", instances, dt=0.01, tolerance=1e-7, command="a test", about="Large.")


def test_a_fused_function_of_too_many_numbers_is_refused_at_once() -> None:
    with pytest.raises(ConfigurationError, match="variables and rows"):
        DenseQP(LARGEST, 1, compile=False)


@pytest.mark.nightly
def test_a_large_qp_has_its_reference_and_costs_those_who_cannot_no_time(tmp_path: Path) -> None:
    who = entrants_named(["proxqp", "proxqp-kept", "qrqp-fused", "ladder"])
    found = list(compare([RecordedQPs(large(60, 40))], who, out=tmp_path, rules=Rules(limit=5.0, repeats=1)))[-1]
    rows = {(row.solver, row.mode): row for row in found.rows}
    assert found.about["sequences"]["large/one"]["references_within_accuracy"] == 3
    for mode in ("cold", "warm"):
        assert rows["proxqp", mode].solved == rows["proxqp-kept", mode].solved == 1.0
        assert rows["qrqp-fused", mode].failures["raised"] == rows["ladder", mode].failures["raised"] == 3
    assert "at most 60 together" in found.done[0].ticks[0].said
