"""Controllers in C, called from Python."""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rehab_opt.control.command import Command
from rehab_opt.control.reasons import REASONS, notes_of, reason_number
from rehab_opt.export.c_source import SOLVERS
from rehab_opt.export.exported import MAX_VALUES
from rehab_opt.export.recording import STATUSES

Built = Callable[..., Path]
Exported = Callable[[str], Path]

ROBOT = "robot/ur5_circle"
SECONDS = 900.0
SAME, BESIDE = 1e-12, 1e-9
"""[rad/s, m/s, N] Of recorded runs; of loops side by side, where rounding may grow from tick to tick."""
SIZE = """\
#include <stddef.h>
#include "rehab_{0}.h"
size_t controller_size(void);
size_t controller_size(void) {{ return sizeof(rehab_{0}); }}
"""


def compiled_once(folder: Path, name: str, built: Built) -> str:
    """Name of the controller's object file, which any test may link."""
    return built(folder, "controller.o", "-c", f"rehab_{name}.c", flags=("-O0", "-fPIC")).name


def shared(folder: Path, name: str, built: Built) -> ctypes.CDLL:
    """The controller, to be called from Python, with `controller_size` besides."""
    (folder / "size.c").write_text(SIZE.format(name))
    object_file = compiled_once(folder, name, built)
    library = ctypes.CDLL(str(built(folder, "controller.so", object_file, "size.c", flags=("-shared", "-fPIC"))))
    library.controller_size.restype = ctypes.c_size_t
    return library


def giving_up(folder: Path, name: str, built: Built, *functions: str) -> ctypes.CDLL:
    """The same, with `give_up(1)` besides: from then on the solves return before they write anything, as qrqp may."""
    source = (folder / f"rehab_{name}.c").read_text()
    export = "#define CASADI_SYMBOL_EXPORT static\n"
    assert source.count(export) == 1
    source = source.replace(export, f"{export}static int given_up;\n")
    for function in functions:
        begin = re.compile(rf"^CASADI_SYMBOL_EXPORT int {function}\(.*\{{$", re.MULTILINE)
        source, count = begin.subn(lambda found: f"{found[0]}\n  if (given_up) return 1;", source)
        assert count == 1
    source += "\nvoid give_up(int now);\nvoid give_up(int now) { given_up = now; }\n"
    (folder / "giving_up.c").write_text(source)
    (folder / "size.c").write_text(SIZE.format(name))
    flags = ("-O0", "-shared", "-fPIC")
    library = ctypes.CDLL(str(built(folder, "giving_up.so", "giving_up.c", "size.c", flags=flags)))
    library.controller_size.restype = ctypes.c_size_t
    return library


def ran(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """What a program printed and how it ended."""
    return subprocess.run(
        [program, *arguments], cwd=program.parent, capture_output=True, text=True, check=False, timeout=SECONDS
    )


class CCommand(ctypes.Structure):
    """`rehab_command`."""

    _fields_ = [
        ("value", ctypes.c_double * MAX_VALUES),
        ("wheels", ctypes.c_double * 4),
        ("scale", ctypes.c_double),
        ("residual", ctypes.c_double),
        *((name, ctypes.c_int) for name in ("status", "relaxed", "reason", "solver", "input", "element", "notes")),
    ]

    @property
    def why(self) -> str:
        """Name of the reason."""
        return REASONS[self.reason].name


def doubles(values: Any) -> Any:
    """An array for C, NULL for None."""
    if values is None:
        return None
    flat = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
    return (ctypes.c_double * flat.size)(*flat)


class CController:
    """A controller in C, called from Python. None, lists and arrays become arrays of doubles, floats doubles."""

    def __init__(self, library: ctypes.CDLL, name: str, *, initialise: bool = True) -> None:
        self.library, self.name = library, name
        self.memory = ctypes.create_string_buffer(library.controller_size())
        if initialise:
            assert self.call("init") == 0

    def call(self, what: str, *arguments: Any) -> int:
        """What a function of the interface returns."""
        return int(getattr(self.library, f"rehab_{self.name}_{what}")(self.memory, *map(for_c, arguments)))

    def told(self, what: str) -> float:
        """The number that a function of the interface returns."""
        asked = getattr(self.library, f"rehab_{self.name}_{what}")
        asked.restype = ctypes.c_double
        return float(asked(self.memory))

    def step(self, *inputs: Any, enable: int = 1, stamp: float) -> CCommand:
        """The command of a tick."""
        out = CCommand()
        self.call("step", *inputs, enable, float(stamp), ctypes.byref(out))
        return out


def for_c(value: Any) -> Any:
    """An argument as C takes it."""
    if isinstance(value, float):
        return ctypes.c_double(value)
    return doubles(value) if value is None or isinstance(value, list | np.ndarray) else value


def assert_same(answer: CCommand, command: Command, tolerance: float = BESIDE) -> None:
    """C commands what Python does, and says the same of it."""
    n, wheels = command.value.size, np.empty(0) if command.wheels is None else command.wheels
    np.testing.assert_allclose(answer.value[:n], command.value, rtol=0, atol=tolerance)
    np.testing.assert_allclose(answer.wheels[: wheels.size], wheels, rtol=0, atol=tolerance)
    assert not any(answer.value[n:])
    assert not any(answer.wheels[wheels.size :])
    assert answer.reason == reason_number(command.reason), (answer.why, command.reason)
    assert answer.notes == notes_of(command.reason)
    assert (answer.status, answer.relaxed) == (STATUSES[command.status], int(command.relaxed))
    assert answer.solver == (SOLVERS.index(command.solver) if command.solver else -1)
    assert abs(answer.scale - command.scale) <= tolerance
    assert answer.residual == pytest.approx(command.residual, abs=BESIDE)


def largest_difference(folder: Path, name: str, built: Built) -> float:
    """Of a command of C from the recorded one of Python, in its units; infinite where what is said of it differs."""
    return difference_told(ran(built(folder, "repeated", compiled_once(folder, name, built), "main.c"), "0"))


def difference_told(done: subprocess.CompletedProcess[str]) -> float:
    """Largest difference from Python that a run of main.c printed."""
    found = re.search(r"largest difference from Python (\S+)", done.stdout)
    assert found is not None, done.stdout + done.stderr
    return float(found[1])
