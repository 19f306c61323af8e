"""Compile CasADi functions to machine code in a cache folder; otherwise CasADi's virtual machine evaluates them.

Environment variables: `REHAB_OPT_COMPILE=0` forces the virtual machine, `REHAB_OPT_COMPILE=wait` waits for the code of
every construction. `REHAB_OPT_CACHE` names another cache folder, `CC` another compiler. `REHAB_OPT_OPTIMISE` sets the
compiler's level, 0 to 3 (default). Loading a library executes it, so libraries of other users, and folders that others
can write to, are not used.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import logging
import os
import platform
import re
import shutil
import stat
import subprocess
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.symbolic.background import idle, later
from rehab_opt.symbolic.constant_table import SETTER, shape_of, with_table

__all__ = [
    "MODES", "Compile", "cache_folder", "compilation_wanted", "compiled", "going_on_after_failed_solves", "how",
    "machine_code", "table_size", "table_step", "tell_of_waiting",
]  # fmt: skip

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
MODES = hasattr(os, "geteuid")  # Windows has no such owners or modes; nothing is checked there

Compile = Literal["wait", False] | None
"""None: as `REHAB_OPT_COMPILE` says, by default in the background; "wait": wait for the code; False: never."""

# No -ffast-math: it removes NaN checks. No contraction to fused multiply-adds and no -march=native, so that the
# virtual machine gives the same numbers and a cache shared by machines holds code that runs on each of them. In
# gnu89 CasADi writes its minimum and maximum as comparisons, where C99 would call a library function for each;
# the two differ only in which NaN they drop, and no certificate rests on either. CasADi exports its square, minimum and
# maximum; no other library's may replace these, or each use would be a call: a third of a tick's time.
FLAGS = (
    "-std=gnu89",
    "-Werror=implicit-function-declaration",
    "-fno-math-errno",
    "-ffp-contract=off",
    "-fPIC",
    "-fno-semantic-interposition",
    "-shared",
)
LEVELS = ("0", "1", "2", "3")
COMPILE_SECONDS, IDLE_SECONDS = 300.0, 1800.0
"""Timeouts of a compiler, at normal and at idle priority."""
WORKPLACE = "building-"
DIGEST = hashlib.sha256().digest_size
"""[bytes] Length of the library's digest; a table of constants begins with this digest."""
EARLY_RETURN = re.compile(
    r"if \(d\.status == QP_SUCCESS\) \{;?\s*return 0;"
    r"\s*\} else if \(d\.status == QP_NO_SEARCH_DIR\) \{\s*return [^;]+;"
    r"\s*\} else \{\s*return [^;]+;\s*\}"
)
"""Code that CasADi writes after each call of qrqp."""
SOLVE = "casadi_qrqp_reset(&d)"
"""Code that occurs at each call of qrqp and not in its definition."""

_log = logging.getLogger(__name__)


_waiting: list[Callable[[str], AbstractContextManager[object]]] = []


@contextmanager
def tell_of_waiting(around: Callable[[str], AbstractContextManager[object]]) -> Iterator[None]:
    """Context in which `around(function name)` surrounds each wait for a compiler; the command line reports it."""
    _waiting.append(around)
    try:
        yield
    finally:
        _waiting.remove(around)


def compiled(function: ca.Function, *, compile: Compile = None) -> ca.Function:
    """`function` as machine code, after a wait for the compiler; unchanged if there is no compiler.

    Name, shapes and, to rounding, results stay the same. The function must support code generation. With `compile`
    False the virtual machine evaluates the function; with `REHAB_OPT_COMPILE=0` it does so for any `compile`.
    """
    code = None if how(compile) == "no" else _code_of(function)
    return function if code is None else _attempt(code, hurry=True) or function


def machine_code(
    function: ca.Function, *, compile: Compile = None, ready: weakref.WeakMethod[Callable[[ca.Function], None]]
) -> ca.Function:
    """`function` as machine code, if cached or awaited; else `function` itself, and `ready` gets the code later.

    Another thread calls `ready`, unless its object is gone by then or compilation failed.
    """
    wanted = how(compile)
    if wanted != "background":
        return compiled(function, compile=compile)
    code = _code_of(function)
    if code is None:
        return function
    known = _attempt(code, build=False)
    if known is not None:
        return known

    def build() -> None:
        if ready() is None:
            return
        result, listener = _attempt(code), ready()
        if result is not None and listener is not None:
            listener(result)

    later(build)
    return function


def how(compile: Compile) -> Literal["no", "background", "wait"]:
    """Mode of compilation that `compile` and `REHAB_OPT_COMPILE` give; an unknown value raises `ConfigurationError`."""
    if not (compile is None or compile is False or compile == "wait"):
        raise ConfigurationError("compile", compile, 'None, "wait" or False')
    if compile is False or not compilation_wanted():
        return "no"
    return "wait" if compile == "wait" or _said() == "wait" else "background"


def compilation_wanted() -> bool:
    """Whether `REHAB_OPT_COMPILE` allows compilation: any value but 0, no, off and false."""
    return _said() not in {"0", "no", "off", "false"}


def optimisation() -> str:
    """Optimisation level in `REHAB_OPT_OPTIMISE`; an unknown one raises `ConfigurationError`."""
    level = os.environ.get("REHAB_OPT_OPTIMISE", "3").strip()
    if level not in LEVELS:
        raise ConfigurationError("REHAB_OPT_OPTIMISE", level, f"one of {', '.join(LEVELS)}")
    return level


def _said() -> str:
    return os.environ.get("REHAB_OPT_COMPILE", "1").strip().lower()


class _Code(NamedTuple):
    """C code of a function, and the compiler for it."""

    function: str
    source: str
    compiler: tuple[str, ...]
    """Command with its flags."""
    version: str

    def digest(self, text: str) -> bytes:
        """Digest of `text` together with this compiler and this machine."""
        return hashlib.sha256("\0".join((text, self.version, *self.compiler[1:], platform.machine())).encode()).digest()


@functools.lru_cache(maxsize=8)
def _code_of(function: ca.Function) -> _Code | None:
    compiler = _compiler()
    if compiler is None:
        _log.info("no C compiler: %s stays in the virtual machine", function.name())
        return None
    generator = ca.CodeGenerator(function.name(), {"verbose": False})
    generator.add(function)
    source = going_on_after_failed_solves(generator.dump())
    return _Code(function.name(), source, (compiler[0], f"-O{optimisation()}", *FLAGS), compiler[1])


def _attempt(code: _Code, *, build: bool = True, hurry: bool = False) -> ca.Function | None:
    """The function from the cache or, if `build` is true, compiled now; None if there is no machine code."""
    try:
        folder, source = _folder(), ""
        own_name = _name(code.function, code.digest(code.source))
        table = known = _cached(folder, own_name, ".table")
        if table is None:
            if not build and not any(folder.glob(f"{code.function}-*.so")):
                return None
            source, constants = with_table(code.source)
            table = code.digest(shape_of(source)) + constants
        name = _name(code.function, table[:DIGEST])
        library = _cached(folder, name, ".so")
        if library is None and build:
            with _waiting[-1](code.function) if hurry and _waiting else nullcontext():
                library = build_library(folder, name, source or with_table(code.source)[0], code.compiler, hurry=hurry)
        if library is None:
            return None
        try:
            function = _load(folder, code.function, library, table[DIGEST:])
        except RuntimeError:  # wrong machine or wrong constants: the next process builds them again
            for each in (*folder.glob(f"{name}-*.so"), *folder.glob(f"{own_name}-*.table")):
                each.unlink(missing_ok=True)
            raise
        if known is None:
            with suppress(OSError), _workplace(folder) as workplace:  # otherwise it would be written each time
                (workplace / "table").write_bytes(table)
                _keep(workplace / "table", folder, own_name, ".table")
    except (OSError, subprocess.SubprocessError, RuntimeError) as problem:
        _log.info("%s stays in the virtual machine: %s", code.function, problem)
        return None
    return function


def _load(folder: Path, function: str, library: bytes, constants: bytes) -> ca.Function:
    """The function with these `constants`, from its own copy of the library: each copy has one table of constants."""
    with _workplace(folder) as workplace:
        copy = workplace / f"{function}.so"
        copy.write_bytes(library)
        loaded = ca.external(function, str(copy))
        ca.external(SETTER, str(copy))(ca.DM(np.frombuffer(constants)))
    return loaded


def _name(function: str, digest: bytes) -> str:
    return f"{function}-{digest.hex()[:32]}"


@contextmanager
def _workplace(folder: Path) -> Iterator[Path]:
    """Temporary folder for unfinished files, inside `folder` if that is writable."""
    try:
        made = tempfile.TemporaryDirectory(dir=folder, prefix=WORKPLACE, ignore_cleanup_errors=True)
    except OSError:
        made = tempfile.TemporaryDirectory(dir=_private_folder(), prefix=WORKPLACE, ignore_cleanup_errors=True)
    with made as workplace:
        yield Path(workplace)


def cache_folder() -> Path:
    """Folder of compiled code: `REHAB_OPT_CACHE`, or the user's cache folder."""
    named = os.environ.get("REHAB_OPT_CACHE")
    if named:
        return Path(named)
    import platformdirs  # noqa: PLC0415  (only where something is compiled)

    return Path(platformdirs.user_cache_dir("rehab_opt"))


def _folder() -> Path:
    """Cache folder with links resolved; if others can write to it, a private folder of this process."""
    wanted = cache_folder()
    make_private(wanted)
    folder = wanted.resolve()
    problem = exposed(folder)
    return _instead_of(folder, problem) if problem else folder


@functools.cache
def _instead_of(folder: Path, problem: str) -> Path:
    """Private folder in place of an unsafe cache folder; the `problem` is logged once."""
    private = _private_folder()
    _log.warning(
        "compiled code is not kept in %s, where others could exchange it: %s. It is compiled again in each process, in "
        "%s; give the cache to this user alone (chown, chmod 700), or name another folder in REHAB_OPT_CACHE",
        folder, problem, private,
    )  # fmt: skip
    return private


@functools.cache
def _private_folder() -> Path:
    """Folder for this process alone, removed when the process ends."""
    folder = Path(tempfile.mkdtemp(prefix="rehab_opt-")).resolve()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    problem = exposed(folder)
    if problem:
        raise PermissionError(problem)
    return folder


def _cached(folder: Path, name: str, kind: str) -> bytes | None:
    """Content of a cached file if it belongs to this user and matches the digest in its name."""
    for file in folder.glob(f"{name}-*{kind}"):
        content = _own_content(file)
        if content is not None and file.stem.rpartition("-")[2] == _digest(content):
            return content
        file.unlink(missing_ok=True)
    return None


def _keep(product: Path, folder: Path, name: str, kind: str) -> bytes:
    """Move a file into the cache in one step, since two processes may build at once."""
    product.chmod(0o700)  # whatever the umask: see `_own_content`
    content = product.read_bytes()
    product.replace(folder / f"{name}-{_digest(content)}{kind}")
    return content


def _clear(folder: Path) -> None:
    """Remove leftovers of processes that were killed while compiling."""
    for workplace in folder.glob(f"{WORKPLACE}*"):
        with suppress(OSError):
            if time.time() - workplace.stat().st_mtime > 2 * IDLE_SECONDS:
                shutil.rmtree(workplace, ignore_errors=True)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _own_content(file: Path) -> bytes | None:
    """Content of a file; None if it is a link or others can change it."""
    try:
        with open(file, "rb", opener=_without_links) as opened:
            return opened.read() if owned(opened.fileno()) else None
    except OSError:
        return None


def _without_links(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def build_library(folder: Path, name: str, source: str, compiler: Sequence[str], *, hurry: bool) -> bytes:
    """Compile in a temporary folder and move the library to its place."""
    _clear(folder)
    with _workplace(folder) as workplace:
        written, product = workplace / "code.c", workplace / "code.so"
        written.write_text(source)
        command = [*compiler, str(written), "-o", str(product), "-lm"]
        # Leftovers of a killed compiler are removed with the folder.
        environment = os.environ | {"TMPDIR": str(workplace)}
        if hurry:
            subprocess.run(command, check=True, capture_output=True, timeout=COMPILE_SECONDS, env=environment)
        else:
            idle(command, environment=environment, seconds=IDLE_SECONDS)
        return _keep(product, folder, name, ".so")


@functools.cache
def _compiler() -> tuple[str, str] | None:
    path = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")
    if path is None:
        return None
    try:
        answer = subprocess.run([path, "--version"], check=True, capture_output=True, text=True, timeout=30.0)
    except (OSError, subprocess.SubprocessError):
        return None
    return path, answer.stdout


def going_on_after_failed_solves(code: str) -> str:
    """Change C code so that a failed qrqp returns its last point and continues, as in the virtual machine.

    In CasADi's own code a failed qrqp returns an error, and all functions around it return without writing their
    outputs. So no certificate judges the point, and no fallback runs. Raises `ConfigurationError` if the installed
    CasADi writes other code for qrqp.
    """
    edited, count = EARLY_RETURN.subn("", code)
    if count != edited.count(SOLVE):
        raise ConfigurationError("casadi", ca.CasadiMeta.version(), "a version that writes C of the form known here")
    return edited


def table_size(count: int) -> int:
    """Number of rows to compile for: `count`, rounded up by at most an eighth or three rows."""
    step = table_step(count)
    return -(-count // step) * step


def table_step(count: int) -> int:
    """Step of `table_size`: a power of two, at least four."""
    return max(4, (1 << count.bit_length()) >> 4)


# -------------------------------------------------- folders that only this user or root can have put something in
def make_private(folder: Path) -> None:
    """Make a folder and its missing parents, accessible to this user alone."""
    for each in (*reversed(folder.parents), folder):
        each.mkdir(mode=0o700, exist_ok=True)


def exposed(folder: Path) -> str:
    """Reason why others could put code into an existing folder (resolved path), or an empty text.

    Others must not be able to write to it or to a folder above it; a sticky folder above, such as /tmp, is safe.
    """
    if not MODES:
        return ""
    for each in (folder, *folder.parents):
        state = each.lstat()
        if not stat.S_ISDIR(state.st_mode):
            return f"{each} is no folder"
        if not _own(state):
            return f"{each} belongs to user {state.st_uid}"
        if state.st_mode & OTHERS_WRITE and (each == folder or not state.st_mode & stat.S_ISVTX):
            return f"{each} may be written by others (mode {stat.S_IMODE(state.st_mode):04o})"
    return ""


def owned(file: int) -> bool:
    """Whether an open file is a regular file of this user or root that nobody else can change."""
    state = os.fstat(file)
    return stat.S_ISREG(state.st_mode) and (not MODES or (_own(state) and not state.st_mode & OTHERS_WRITE))


def _own(state: os.stat_result) -> bool:
    return state.st_uid in {0, os.geteuid()}
