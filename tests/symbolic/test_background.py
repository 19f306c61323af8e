"""Functions answer at once, and go over to machine code between two calls when a compiler beside them is done."""

import gc
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from rehab_opt import PoseTracker, ur5
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.background import finished, later
from rehab_opt.symbolic.compiled import _compiler, compiled
from tests.refusals import refuses

pytestmark = pytest.mark.skipif(_compiler() is None, reason="no C compiler on this machine")
MACHINE_CODE, VIRTUAL_MACHINE = "External", "SXFunction"
PATIENCE = 300.0
"""[s] that something may take on a busy machine."""
START = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])


@pytest.fixture(autouse=True)
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With a `nice` that sees what it is asked for and does not do it: a busy machine gets to no idle compiler."""
    assert finished(PATIENCE)
    nice = tmp_path / "bin" / "nice"
    nice.parent.mkdir()
    nice.write_text('#!/bin/sh\n[ "$1 $2" = "-n 19" ] && shift 2 && exec "$@"\n')
    nice.chmod(0o700)
    monkeypatch.setenv("PATH", f"{nice.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("REHAB_OPT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("REHAB_OPT_COMPILE", raising=False)
    return tmp_path / "cache"


@pytest.fixture
def slow_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A compiler that makes a file `begun` beside the one that is given back, and does not end before that is there."""
    gate, real = tmp_path / "go", shutil.which("cc") or shutil.which("gcc")
    script = tmp_path / "slow-cc"
    script.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] && exec {real} --version\ntouch {tmp_path}/begun\n'
        f'while [ ! -e {gate} ]; do sleep 0.02; done\nexec {real} "$@"\n'
    )
    script.chmod(0o700)
    monkeypatch.setenv("CC", str(script))
    _compiler.cache_clear()
    yield gate
    gate.touch()
    assert finished(PATIENCE)
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
    assert finished(PATIENCE)
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


def test_nothing_is_compiled_for_what_is_gone(slow_compiler: Path, empty_cache: Path) -> None:
    kept, gone = (BufferedFunction(cubes(name), compile=None) for name in ("kept", "gone"))
    del gone
    gc.collect()
    slow_compiler.touch()
    assert finished(PATIENCE)
    assert [each.name.partition("-")[0] for each in empty_cache.glob("*.so")] == ["kept"]
    assert kept.function.class_name() == MACHINE_CODE


def test_anything_else_is_refused_by_name() -> None:
    values = [True, "yes", 1, 0, "background"]
    words = "compile = ", 'expected None, "wait" or False'
    refuses(PoseTracker, *(({"chain": ur5(), "compile": value}, *words) for value in values))


@pytest.mark.parametrize("kind", [PoseTracker])
def test_a_loop_goes_over_without_a_jump(kind: type[PoseTracker], slow_compiler: Path) -> None:
    robot = ur5(acceleration=np.full(6, 3.0))
    changing, steady = kind(robot), kind(robot, compile=False)
    pose = robot.pose(START)
    pose[:3, 3] += 0.03, -0.05, 0.04
    q, still = START.copy(), np.zeros(6)
    for k in range(200):
        if k == 100:
            slow_compiler.touch()
            assert finished(PATIENCE)
        one, other = changing.step(q, pose, still), steady.step(q, pose, still)
        np.testing.assert_allclose(one.value, other.value, rtol=0, atol=1e-12)
        assert (one.status, one.relaxed) == (other.status, other.relaxed)
        q = q + 0.001 * one.value
    assert np.linalg.norm(q - START) > 0.005


def ended(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """A process that ends while it compiles in the background."""
    script = f"import casadi as ca; from rehab_opt.symbolic import BufferedFunction\nx = ca.SX.sym('x', 3)\n{code}\n"
    command = [sys.executable, "-c", script, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE)


MAKE = "f = BufferedFunction(ca.Function('left', [x], [ca.sin(x)]), compile=None)"


def test_process_that_ends_leaves_no_compiler_and_no_folder(slow_compiler: Path, empty_cache: Path) -> None:
    begun = slow_compiler.with_name("begun")
    done = ended(f"import os, sys, time\n{MAKE}\nwhile not os.path.exists(sys.argv[1]): time.sleep(0.01)", begun)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert list(empty_cache.iterdir()) == []
    until = time.monotonic() + 10.0  # what was killed is listed until a busy machine has got to it
    while str(slow_compiler.parent) in (running := _processes()) and time.monotonic() < until:
        time.sleep(0.1)
    assert str(slow_compiler.parent) not in running


def _processes() -> str:
    return subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_forked_process_begins_with_no_work(slow_compiler: Path) -> None:
    code = (
        f"{MAKE}\nimport os\nfrom rehab_opt.symbolic.background import finished\n"
        "if os.fork() == 0:\n    print(finished(5.0), flush=True)\n    os._exit(0)\nos.wait()"
    )
    assert ended(code).stdout == "True\n"


def test_what_a_killed_process_left_is_removed_in_time(empty_cache: Path) -> None:
    left, fresh = empty_cache / "building-old", empty_cache / "building-new"
    for each in (left, fresh):
        each.mkdir(parents=True, mode=0o700)
    empty_cache.chmod(0o700)
    os.utime(left, (0, 0))
    compiled(cubes("clears"), compile="wait")
    assert not left.exists()
    assert fresh.exists()


def test_a_loop_is_asked_for_its_turn_soon_while_there_is_work_and_as_usual_afterwards() -> None:
    """A tick of 1 ms that lets others run for a moment never lasted the usual 5 ms, after which a turn is asked for."""
    before, seen = sys.getswitchinterval(), list[float]()
    later(lambda: seen.append(sys.getswitchinterval()))
    assert finished(10.0)
    assert seen[0] <= 5e-4 < before == sys.getswitchinterval()
