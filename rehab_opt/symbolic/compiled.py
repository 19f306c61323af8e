"""CasADi functions as machine code, kept in the user's cache folder; the virtual machine where that is not possible.

`REHAB_OPT_COMPILE=0` forces the virtual machine, `REHAB_OPT_CACHE` names another cache folder, `CC` another compiler.
What is loaded runs: a folder that others may write to is not used, and neither is a library that another user owns.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca

from rehab_opt.symbolic.failed_solves import going_on_after_failed_solves
from rehab_opt.symbolic.own_folder import exposed, make_private, owned

__all__ = ["cache_folder", "compilation_wanted", "compiled"]

# No -ffast-math: it removes NaN checks. No contraction to fused multiply-adds and no -march=native, so that the
# virtual machine gives the same numbers and a cache shared by machines holds code that runs on each of them. In
# gnu89 CasADi writes its minimum and maximum as comparisons, where C99 would call a library function for each;
# the two differ only in which NaN they drop, and what rests on neither is certified. CasADi exports its square, minimum
# and maximum; no other library's may take their place, or each would be a call: a third of a tick's time.
FLAGS = (
    "-O3",
    "-std=gnu89",
    "-Werror=implicit-function-declaration",
    "-fno-math-errno",
    "-ffp-contract=off",
    "-fPIC",
    "-fno-semantic-interposition",
    "-shared",
)
COMPILE_SECONDS = 300.0

_log = logging.getLogger(__name__)


def compiled(function: ca.Function, *, compile: bool | None = None) -> ca.Function:
    """`function` as machine code where a compiler is present, unchanged where not.

    Parameters
    ----------
    function : what to compile; must support code generation.
    compile : False keeps the virtual machine, and so does `REHAB_OPT_COMPILE=0` whatever stands here.

    Returns
    -------
    A function of the same name, shapes and, to rounding, the same results.
    """
    if compile is False or not compilation_wanted():
        return function
    compiler = _compiler()
    if compiler is None:
        _log.info("no C compiler: %s stays in the virtual machine", function.name())
        return function
    generator = ca.CodeGenerator(function.name())
    generator.add(function)
    source = going_on_after_failed_solves(generator.dump())
    key = hashlib.sha256("\0".join((source, compiler[1], *FLAGS, platform.machine())).encode()).hexdigest()[:32]
    name, result = f"{function.name()}-{key}", function
    try:
        folder = _folder()
        library = _cached(folder, name) or _build(folder, source, compiler[0], name)
        result = ca.external(function.name(), str(library))
    except (OSError, subprocess.SubprocessError, RuntimeError) as problem:
        _log.info("%s stays in the virtual machine: %s", function.name(), problem)
    return result


def compilation_wanted() -> bool:
    """What `REHAB_OPT_COMPILE` says: everything but 0, no, off and false means yes."""
    return os.environ.get("REHAB_OPT_COMPILE", "1").strip().lower() not in {"0", "no", "off", "false"}


def cache_folder() -> Path:
    """Where compiled code is kept: `REHAB_OPT_CACHE`, or the user's cache folder."""
    named = os.environ.get("REHAB_OPT_CACHE")
    if named:
        return Path(named)
    import platformdirs  # noqa: PLC0415  (only where something is compiled)

    return Path(platformdirs.user_cache_dir("rehab_opt"))


def _folder() -> Path:
    """The cache folder without links in its path, or one for this process alone where others may write to it."""
    wanted = cache_folder()
    make_private(wanted)
    folder = wanted.resolve()
    problem = exposed(folder)
    return _instead_of(folder, problem) if problem else folder


@functools.cache
def _instead_of(folder: Path, problem: str) -> Path:
    """A private folder; why, is said once."""
    private = _private_folder()
    _log.warning(
        "compiled code is not kept in %s, where others could exchange it: %s. It is compiled again in each process, in "
        "%s; give the cache to this user alone (chown, chmod 700), or name another folder in REHAB_OPT_CACHE",
        folder, problem, private,
    )  # fmt: skip
    return private


@functools.cache
def _private_folder() -> Path:
    """A folder for this process alone, removed at its end."""
    folder = Path(tempfile.mkdtemp(prefix="rehab_opt-")).resolve()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    problem = exposed(folder)
    if problem:
        raise PermissionError(problem)
    return folder


def _cached(folder: Path, name: str) -> Path | None:
    """The library of that name, this user's and undamaged: its own digest ends its name.

    Loading a cut one would end the process.
    """
    for library in folder.glob(f"{name}-*.so"):
        if library.stem.rpartition("-")[2] == _digest(library):
            return library
        library.unlink(missing_ok=True)
    return None


def _digest(library: Path) -> str:
    """Of the library's content; nothing where it is a link or not this user's alone."""
    try:
        with open(library, "rb", opener=_without_links) as file:
            return hashlib.sha256(file.read()).hexdigest()[:16] if owned(file.fileno()) else ""
    except OSError:
        return ""


def _without_links(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _build(folder: Path, source: str, compiler: str, name: str) -> Path:
    """Compile beside the target and move it there in one step: two processes may build at once."""
    with tempfile.TemporaryDirectory(dir=folder) as workplace:
        code, product = Path(workplace) / "code.c", Path(workplace) / "code.so"
        code.write_text(source)
        subprocess.run(
            [compiler, *FLAGS, str(code), "-o", str(product), "-lm"],
            check=True,
            capture_output=True,
            timeout=COMPILE_SECONDS,
        )
        product.chmod(0o700)  # whatever the umask: see `_digest`
        return product.replace(folder / f"{name}-{_digest(product)}.so")


@functools.cache
def _compiler() -> tuple[str, str] | None:
    """Path and version of the C compiler, or None."""
    path = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")
    if path is None:
        return None
    try:
        answer = subprocess.run([path, "--version"], check=True, capture_output=True, text=True, timeout=30.0)
    except (OSError, subprocess.SubprocessError):
        return None
    return path, answer.stdout
