"""What a command says while it waits."""

from __future__ import annotations

import shutil
from pathlib import Path

import casadi as ca
import pytest

from rehab_opt.symbolic.compiled import compiled
from rehab_opt.terminal import bars


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_wait_for_the_compiler_is_announced_once_and_counted_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("REHAB_OPT_CACHE", str(tmp_path))
    monkeypatch.setenv("REHAB_OPT_COMPILE", "wait")
    x = ca.SX.sym("x", 3)
    with bars():
        for power in (2, 3):
            assert float(compiled(ca.Function(f"sum_of_power_{power}", [x], [ca.sum1(x**power)]))([1, 2, 3])) > 10
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 2
    assert "REHAB_OPT_COMPILE=0" in lines[0]
    assert lines[1].startswith("rehab-opt: compiled 2 functions in ")
    with bars():
        pass
    assert capfd.readouterr().err == ""
