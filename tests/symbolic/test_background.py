"""Functions answer at once, and go over to machine code between two calls when a compiler beside them is done."""

import gc
import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from rehab_opt import ConfigurationError, MirrorTracker, PoseTracker, ur5
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.background import finished
from rehab_opt.symbolic.compiled import _compiler, compiled

pytestmark = pytest.mark.skipif(_compiler() is None, reason="no C compiler on this machine")
MACHINE_CODE, VIRTUAL_MACHINE = "External", "SXFunction"
START = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])


@pytest.fixture(autouse=True)
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    assert finished(60.0)
    monkeypatch.setenv("REHAB_OPT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("REHAB_OPT_COMPILE", raising=False)
    return tmp_path / "cache"


@pytest.fixture
def slow_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A compiler that does not end before the file that is given back is there."""
    gate, real = tmp_path / "go", shutil.which("cc") or shutil.which("gcc")
    script = tmp_path / "slow-cc"
    script.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] && exec {real} --version\nwhile [ ! -e {gate} ]; do sleep 0.02; done\n'
        f'exec {real} "$@"\n'
    )
    script.chmod(0o700)
    monkeypatch.setenv("CC", str(script))
    _compiler.cache_clear()
    yield gate
    gate.touch()
    assert finished(60.0)
    monkeypatch.undo()
    _compiler.cache_clear()


def cubes(name: str) -> ca.Function:
    x = ca.SX.sym("x", 3)
    return ca.Function(name, [x], [ca.sin(x) * x**3])


def test_function_answers_at_once_and_goes_over_on_the_same_arrays(slow_compiler: Path) -> None:
    function = BufferedFunction(cubes("at_once"), compile=None)
    held, read = function.inputs[0], function.outputs[0]
    assert function.function.class_name() == VIRTUAL_MACHINE
    held[:] = 1.0, 2.0, 3.0
    function()
    before = read.copy()
    slow_compiler.touch()
    assert finished(60.0)
    assert function.function.class_name() == MACHINE_CODE
    read[:] = np.nan
    function()
    np.testing.assert_allclose(read, before, rtol=1e-15)


def test_waiting_is_what_the_argument_or_the_environment_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    assert BufferedFunction(cubes("waited_for"), compile="wait").function.class_name() == MACHINE_CODE
    monkeypatch.setenv("REHAB_OPT_COMPILE", "wait")
    assert BufferedFunction(cubes("waited_too"), compile=None).function.class_name() == MACHINE_CODE
    monkeypatch.setenv("REHAB_OPT_COMPILE", "0")
    assert BufferedFunction(cubes("not_at_all"), compile="wait").function.class_name() == VIRTUAL_MACHINE


def test_what_is_in_the_cache_needs_no_background() -> None:
    compiled(cubes("cached"), compile="wait")
    assert BufferedFunction(cubes("cached"), compile=None).function.class_name() == MACHINE_CODE


def test_nothing_is_compiled_for_what_is_gone(slow_compiler: Path, empty_cache: Path) -> None:
    kept, gone = (BufferedFunction(cubes(name), compile=None) for name in ("kept", "gone"))
    del gone
    gc.collect()
    slow_compiler.touch()
    assert finished(60.0)
    assert [each.name.partition("-")[0] for each in empty_cache.glob("*.so")] == ["kept"]
    assert kept.function.class_name() == MACHINE_CODE


def test_compiler_that_fails_leaves_the_virtual_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\necho 1.0\n[ $# = 1 ]\n")
    broken.chmod(0o700)
    monkeypatch.setenv("CC", str(broken))
    _compiler.cache_clear()
    function = BufferedFunction(cubes("broken"), compile=None)
    assert finished(60.0)
    _compiler.cache_clear()
    assert function.function.class_name() == VIRTUAL_MACHINE
    assert function.of([1.0, 2.0, 3.0])[0] == pytest.approx(np.sin(1.0))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("value", [True, "yes", 1, 0, "background"])
def test_anything_else_is_refused_by_name(value: object) -> None:
    with pytest.raises(ConfigurationError, match=r'compile = .*expected None, "wait" or False'):
        PoseTracker(ur5(), compile=value)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [PoseTracker, MirrorTracker])
def test_a_loop_goes_over_without_a_jump(kind: type[PoseTracker], slow_compiler: Path) -> None:
    robot = ur5(acceleration=np.full(6, 3.0))
    changing, steady = kind(robot), kind(robot, compile=False)
    pose = robot.pose(START)
    pose[:3, 3] += 0.03, -0.05, 0.04
    q, still = START.copy(), np.zeros(6)
    for k in range(400):
        if k == 200:
            slow_compiler.touch()
            assert finished(120.0)
        one, other = changing.step(q, pose, still), steady.step(q, pose, still)
        np.testing.assert_allclose(one.value, other.value, rtol=0, atol=1e-12)
        assert (one.status, one.yielded) == (other.status, other.yielded)
        q = q + 0.001 * one.value
    assert np.linalg.norm(q - START) > 0.01
