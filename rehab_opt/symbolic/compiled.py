"""CasADi functions as machine code, kept in the user's cache folder; the virtual machine where that is not possible.

`REHAB_OPT_COMPILE=0` forces the virtual machine, `REHAB_OPT_CACHE` names another cache folder, `CC` another compiler.
"""

from __future__ import annotations

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
        result = ca.external(function.name(), str(_cached(name) or _build(source, compiler[0], name)))
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


def _cached(name: str) -> Path | None:
    """The library of that name, undamaged: its own digest ends its name. Loading a cut one would end the process."""
    for library in cache_folder().glob(f"{name}-*.so"):
        if library.stem.rpartition("-")[2] == _digest(library):
            return library
        library.unlink(missing_ok=True)
    return None


def _digest(library: Path) -> str:
    return hashlib.sha256(library.read_bytes()).hexdigest()[:16]


def _build(source: str, compiler: str, name: str) -> Path:
    """Compile beside the target and move it there in one step: two processes may build at once."""
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.TemporaryDirectory(dir=folder) as workplace:
        code, product = Path(workplace) / "code.c", Path(workplace) / "code.so"
        code.write_text(source)
        subprocess.run(
            [compiler, *FLAGS, str(code), "-o", str(product), "-lm"],
            check=True,
            capture_output=True,
            timeout=COMPILE_SECONDS,
        )
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
