"""The way bench/README.md says a solver of one's own takes part, as it stands there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

README = Path(__file__).parents[2] / "bench" / "README.md"


@pytest.mark.nightly
@pytest.mark.skipif(not README.is_file(), reason="needs the checkout")
def test_the_example_takes_part_in_a_comparison(tmp_path: Path) -> None:
    (example,) = re.findall(r"### A solver of your own.*?```python\n(.*?)```", README.read_text(), re.DOTALL)
    (tmp_path / "mine.py").write_text(example)
    paths = os.pathsep.join([str(README.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
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
