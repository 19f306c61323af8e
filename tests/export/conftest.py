"""Exported controllers, made once and built where a C compiler is present."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from rehab_opt.export.export_c import export_c
from rehab_opt.session.files import load_problem

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror")
ARITHMETIC = ("-fno-math-errno", "-ffp-contract=off")
SECONDS = 120.0


@pytest.fixture(scope="session")
def c_compiler() -> str:
    """Path of a C compiler; the test is skipped where there is none."""
    found = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler (gcc, cc, clang) is installed")
    return found


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of the C files of a problem."""
    folders: dict[str, Path] = {}

    def folder(problem: str) -> Path:
        if problem not in folders:
            folders[problem] = tmp_path_factory.mktemp("c") / "exported"
            export_c(load_problem(problem), folders[problem])
        return folders[problem]

    return folder


@pytest.fixture(scope="session")
def built(c_compiler: str) -> Callable[..., Path]:
    """Compile files of a folder, with the flags of the project's CMake file and more, into a product beside them."""

    def product(folder: Path, name: str, *files: str, flags: tuple[str, ...] = ()) -> Path:
        command = [c_compiler, *WARNINGS, *ARITHMETIC, *flags, *files, "-o", name, "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=SECONDS)
        assert done.returncode == 0, done.stderr
        return folder / name

    return product


def ran(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """What a program printed and how it ended."""
    return subprocess.run(
        [program, *arguments], cwd=program.parent, capture_output=True, text=True, check=False, timeout=SECONDS
    )
