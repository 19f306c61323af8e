"""bench/own_solver.py, the example of a solver of one's own, takes part in a comparison."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "bench" / "own_solver.py"


@pytest.mark.nightly
@pytest.mark.skipif(not EXAMPLE.is_file(), reason="needs the checkout")
def test_the_example_takes_part_in_a_comparison(tmp_path: Path) -> None:
    shutil.copy(EXAMPLE, tmp_path / "mine.py")
    paths = os.pathsep.join([str(EXAMPLE.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "mine.py"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "out/mine/results.json").read_text())["rows"]
    own = {(row["solver"], row["mode"]): row for row in rows}
    assert set(own) == {(solver, mode) for solver in ("daqp", "projected") for mode in ("cold", "warm")}
    assert own["daqp", "warm"]["solved"] == 1.0
    failures = own["projected", "cold"]["failures"]
    assert failures["wrong answer"] > 0
    assert failures["raised"] == failures["too late"] == failures["no answer"] == 0
