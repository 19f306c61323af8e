"""Machine code gives the virtual machine's numbers, and whatever stands in its way, the virtual machine takes over."""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.qrqp import qrqp
from rehab_opt.symbolic import BufferedFunction, compiled
from rehab_opt.symbolic.compiled import (
    FLAGS,
    MODES,
    _compiler,
    _digest,
    cache_folder,
    compilation_wanted,
    going_on_after_failed_solves,
)
from rehab_opt.symbolic.constant_table import with_table
from tests.refusals import refuses

needs_compiler = pytest.mark.skipif(_compiler() is None, reason="no C compiler on this machine")
MACHINE_CODE, VIRTUAL_MACHINE = "External", "SXFunction"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shipped: None) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("REHAB_OPT_CACHE", str(folder))
    return folder


@pytest.fixture
def look_again() -> Iterator[Callable[[], None]]:
    """The compiler is looked for once in a process: forget what was found, now and afterwards."""
    _compiler.cache_clear()
    yield _compiler.cache_clear
    _compiler.cache_clear()


def test_a_casadi_whose_solves_end_in_another_way_is_refused() -> None:
    """Else a failed solve would end the tick around it, with nothing written and no certificate."""
    generator = ca.CodeGenerator("two")
    for each in (qrqp("one", 3, 2), qrqp("other", 4, 1)):
        generator.add(each)
    code = generator.dump()
    assert going_on_after_failed_solves(code) != code
    with pytest.raises(ConfigurationError, match="casadi"):
        going_on_after_failed_solves(code.replace("d.status == QP_NO_SEARCH_DIR", "d.status == QP_NO_DIRECTION", 1))


def square(name: str = "square") -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function(name, [x], [x * x + 1])


def random_function(seed: int, size: int = 300) -> ca.Function:
    """A random graph of the operations that kinematics and certificates are made of, on 4 numbers.

    Minimum and maximum may give a zero of another sign in machine code, so the cut of atan2 is kept away from.
    """
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", 4)
    nodes = [x[i] for i in range(4)]
    one = [
        ca.sin, ca.cos, ca.fabs, ca.sign, ca.floor, ca.tanh, ca.atan,
        lambda a: ca.sqrt(ca.fabs(a)), lambda a: ca.exp(ca.tanh(a)), lambda a: 1 / (1 + a * a),
    ]  # fmt: skip
    two = [
        lambda a, b: a + b, lambda a, b: a - b, lambda a, b: ca.sin(a) * b, ca.fmin, ca.fmax,
        lambda a, b: ca.atan2(a, 0.1 + b * b),
        lambda a, b: ca.if_else(a <= b, a, ca.cos(b)), lambda a, b: ca.logic_and(a > 0, b > 0),
    ]  # fmt: skip
    for _ in range(size):
        a, b = (nodes[i] for i in rng.integers(max(0, len(nodes) - 40), len(nodes), 2))
        nodes.append(rng.choice(one)(a) if rng.random() < 0.5 else rng.choice(two)(a, b))
    return ca.Function(f"random_{seed}", [x], [ca.vertcat(*nodes[-60:])], {"cse": True})


# ------------------------------------------------------------------------------------------------------- numbers
@needs_compiler
@pytest.mark.parametrize("seed", range(2))
def test_machine_code_gives_the_virtual_machine_s_numbers(cache: Path, seed: int) -> None:
    function = random_function(seed)
    fast = compiled(function, compile="wait")
    assert fast.class_name() == MACHINE_CODE
    assert (fast.name(), fast.size1_in(0), fast.size1_out(0)) == (function.name(), 4, 60)
    slow, quick = BufferedFunction(function), BufferedFunction(fast)
    for values in np.random.default_rng(seed).normal(scale=3, size=(500, 4)):
        np.testing.assert_allclose(quick.of(values), slow.of(values), rtol=1e-12, atol=1e-12)


@needs_compiler
def test_products_and_sums_are_rounded_apart(cache: Path) -> None:
    x = ca.SX.sym("x", 3)
    function = ca.Function("muladd", [x], [x[0] * x[1] + x[2]])
    slow, quick = BufferedFunction(function), BufferedFunction(compiled(function, compile="wait"))
    a = 1 + 2.0**-30
    assert quick.of([a, a, -a * a])[0] == 0.0  # a fused multiply-add would give 2^-60
    for values in np.random.default_rng(0).normal(size=(1000, 3)):
        assert quick.of(values)[0] == slow.of(values)[0]


@needs_compiler
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_comparison_with_nan_holds_in_machine_code(cache: Path, value: float) -> None:
    x = ca.SX.sym("x")
    function = ca.Function("compare", [x], [ca.vertcat(x <= 1, x >= 1, x < 1, x > 1, ca.fabs(x) <= 1e30, x + 0)])
    expected = [value <= 1, value >= 1, value < 1, value > 1, abs(value) <= 1e30, value]
    np.testing.assert_array_equal(BufferedFunction(compiled(function, compile="wait")).of([value]), expected)


@needs_compiler
def test_a_level_of_the_compiler_that_is_none_is_refused(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for level in ("4", "fast", "-1", ""):
        monkeypatch.setenv("REHAB_OPT_OPTIMISE", level)
        refuses(compiled, ((square(),), "REHAB_OPT_OPTIMISE"))


# --------------------------------------------------------------------------------------------------------- cache
@needs_compiler
@pytest.mark.parametrize("content", [b"this is no library", b"\x7fELF" + bytes(100)])
def test_a_damaged_library_is_replaced(cache: Path, content: bytes) -> None:
    compiled(square(), compile="wait")
    (library,) = cache.glob("*.so")
    library.unlink()  # what is loaded stays loaded: the name gets another file
    library.write_bytes(content)
    first = compiled(square(), compile="wait")
    assert BufferedFunction(first).of([2.0, 3.0]).tolist() == [5.0, 10.0]
    again = compiled(square(), compile="wait")
    assert again.class_name() == MACHINE_CODE
    assert BufferedFunction(again).of([2.0, 3.0]).tolist() == [5.0, 10.0]


@needs_compiler
def test_a_cache_that_can_be_read_alone_serves(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that root has filled for others: what is loaded is a copy, in a folder of this process."""
    compiled(square(), compile="wait")
    made = tempfile.TemporaryDirectory

    def refused(*, dir: Path, **options: Any) -> tempfile.TemporaryDirectory[str]:
        if Path(dir) == cache.resolve():
            raise PermissionError(13, "Permission denied", str(dir))
        return made(dir=dir, **options)

    monkeypatch.setattr(tempfile, "TemporaryDirectory", refused)
    function = compiled(square(), compile="wait")
    assert function.class_name() == MACHINE_CODE
    assert BufferedFunction(function).of([2.0, 3.0]).tolist() == [5.0, 10.0]


def test_the_cache_is_where_the_environment_says(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cache_folder() == cache
    monkeypatch.delenv("REHAB_OPT_CACHE")
    assert cache_folder().name == "rehab_opt"


# -------------------------------------------------------------------------------------------------- what is loaded
needs_modes = pytest.mark.skipif(not MODES, reason="folders have no owners and modes on this system")
needs_root = pytest.mark.skipif(not MODES or os.geteuid() != 0, reason="only root can give files away")
STRANGER = 12345


def planted(cache: Path) -> Path:
    """A library of the right name and digest in the cache, which gives 42 for every square."""
    compiled(square(), compile="wait")
    (library,) = cache.glob("*.so")
    generator = ca.CodeGenerator("square", {"verbose": False})
    generator.add(square())
    evil_code, count = re.subn(r"(?<=res\[0\]\[[01]\]=)a\d+", "42.", with_table(generator.dump())[0])
    assert count == 2
    (cache / "evil.c").write_text(evil_code)
    command = [_compiler()[0], *FLAGS, str(cache / "evil.c"), "-o", str(cache / "evil.so"), "-lm"]  # type: ignore[index]
    subprocess.run(command, check=True)
    (cache / "evil.c").unlink()
    library.unlink()
    digest = _digest((cache / "evil.so").read_bytes())
    evil = (cache / "evil.so").rename(cache / f"{library.stem.rpartition('-')[0]}-{digest}.so")
    evil.chmod(0o700)
    return evil


def answer() -> list[float]:
    return BufferedFunction(compiled(square(), compile="wait")).of([2.0, 3.0]).tolist()  # type: ignore[no-any-return]


@needs_compiler
def test_what_is_planted_would_be_run(cache: Path) -> None:
    """The checks below would be green without this, if what is planted could not be loaded."""
    planted(cache)
    assert answer() == [42.0, 42.0]


@needs_compiler
@needs_modes
@pytest.mark.parametrize("mode", [0o770, 0o1777])
def test_a_cache_that_others_may_write_to_is_not_used_and_said_so_once(
    cache: Path, mode: int, caplog: pytest.LogCaptureFixture
) -> None:
    evil = planted(cache)
    cache.chmod(mode)
    assert [answer(), answer()] == [[5.0, 10.0]] * 2
    assert compiled(square(), compile="wait").class_name() == MACHINE_CODE  # elsewhere, for this process
    assert list(cache.glob("*.so")) == [evil]
    (warning,) = [each.getMessage() for each in caplog.records if each.levelname == "WARNING"]
    assert str(cache) in warning
    assert "chmod 700" in warning


@needs_compiler
@needs_modes
def test_a_cache_below_a_folder_that_others_may_write_to_is_not_used(cache: Path) -> None:
    planted(cache)
    cache.parent.chmod(0o777)  # others could put another folder in the cache's place
    assert answer() == [5.0, 10.0]
    cache.parent.chmod(0o1777)  # in a sticky one, such as /tmp, they cannot
    assert answer() == [42.0, 42.0]


@needs_compiler
@needs_root
def test_a_cache_or_a_library_of_another_user_is_not_used(cache: Path) -> None:
    evil = planted(cache)
    os.chown(evil, STRANGER, -1)
    assert answer() == [5.0, 10.0]
    assert not evil.exists()  # it was replaced
    evil = planted(cache)
    os.chown(cache, STRANGER, -1)
    assert answer() == [5.0, 10.0]
    os.chown(cache, 0, -1)
    assert answer() == [42.0, 42.0]
    os.chown(cache.parent, STRANGER, -1)
    assert answer() == [5.0, 10.0]


@needs_compiler
@needs_modes
def test_a_library_that_others_may_write_to_is_compiled_again(cache: Path) -> None:
    planted(cache).chmod(0o722)
    assert answer() == [5.0, 10.0]


@needs_compiler
@needs_modes
def test_a_link_in_a_library_s_place_is_compiled_again(cache: Path, tmp_path: Path) -> None:
    evil = planted(cache)
    elsewhere = evil.rename(tmp_path / "evil.so")
    evil.symlink_to(elsewhere)
    assert answer() == [5.0, 10.0]
    assert elsewhere.exists()
    assert not evil.is_symlink()


@needs_compiler
@needs_modes
def test_folders_and_libraries_are_made_for_this_user_alone_whatever_the_umask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHAB_OPT_CACHE", str(tmp_path / "home" / "deep" / "cache"))
    monkeypatch.setenv("REHAB_OPT_COMPILE", "wait")
    before = os.umask(0)
    try:
        assert answer() == [5.0, 10.0]
    finally:
        os.umask(before)
    made = list((tmp_path / "home").rglob("*"))
    assert len(made) == 4  # two folders, the code and its constants
    assert {each.stat().st_mode & 0o777 for each in (tmp_path / "home", *made)} == {0o700}
    built = {each: each.stat().st_mtime_ns for each in made if each.is_file()}
    assert answer() == [5.0, 10.0]
    assert {each: each.stat().st_mtime_ns for each in built} == built


# --------------------------------------------------------------------------------------------- without a compiler
def test_without_a_compiler_the_virtual_machine_takes_over(
    cache: Path, monkeypatch: pytest.MonkeyPatch, look_again: Callable[[], None], capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", "/nowhere/cc")
    monkeypatch.setenv("PATH", "")
    function = compiled(square(), compile="wait")
    assert function.class_name() == VIRTUAL_MACHINE
    assert BufferedFunction(function).of([2.0, 3.0]).tolist() == [5.0, 10.0]
    assert not cache.exists()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("script", ["exit 1", "echo 1.0; for a; do :; done"])
def test_a_compiler_that_fails_is_done_without(
    cache: Path, monkeypatch: pytest.MonkeyPatch, look_again: Callable[[], None], tmp_path: Path, script: str
) -> None:
    shell = shutil.which("sh")
    broken = tmp_path / "broken-cc"
    broken.write_text(f"#!{shell}\n{script}\n")
    broken.chmod(0o700)
    monkeypatch.setenv("CC", str(broken))
    function = compiled(square(), compile="wait")
    assert function.class_name() == VIRTUAL_MACHINE
    assert BufferedFunction(function).of([2.0, 3.0]).tolist() == [5.0, 10.0]


@pytest.mark.parametrize(("said", "wanted"), [("0", False), ("no", False), (" OFF ", False), ("1", True), ("", True)])
def test_the_environment_decides_where_the_caller_does_not(
    cache: Path, monkeypatch: pytest.MonkeyPatch, said: str, wanted: bool
) -> None:
    monkeypatch.setenv("REHAB_OPT_COMPILE", said)
    assert compilation_wanted() is wanted
    if not wanted:
        assert compiled(square()).class_name() == VIRTUAL_MACHINE
        assert not cache.exists()


@needs_compiler
def test_a_qrqp_that_fails_goes_on_in_machine_code_as_in_the_virtual_machine(cache: Path) -> None:
    """Two steps of the many that are needed: what comes after must still run, and on the same point."""

    def solution(steps: int) -> ca.Function:
        start = ca.MX.sym("start", 3)
        box = {"lbx": -np.ones(3), "ubx": np.ones(3), "a": np.ones((1, 3)), "lba": -1, "uba": 2}
        solver = qrqp("steps", 3, 1, iterations=steps)
        answer = solver(h=np.diag([1.0, 2.0, 3.0]), g=[-9.0, -8.0, -7.0], x0=start, **box)["x"]
        return ca.Function("solution", [start], [answer, 2 * start])

    machine_code = compiled(solution(2))
    assert machine_code.class_name() == MACHINE_CODE
    solved, failed, expected = (BufferedFunction(each) for each in (solution(50), machine_code, solution(2)))
    for each in (solved, failed, expected):
        each.inputs[0][:] = -1.0, 1.0, -1.0
        each.outputs[1][:] = np.nan
        each()
    assert np.abs(failed.outputs[0] - solved.outputs[0]).max() > 1e-3  # it did fail
    np.testing.assert_allclose(failed.outputs[0], expected.outputs[0], atol=1e-15)
    np.testing.assert_array_equal(failed.outputs[1], [-2.0, 2.0, -2.0])
