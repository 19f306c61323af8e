"""Exported controllers, made once and built where a C compiler is present."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from rehab_opt.export.export_c import export_c
from rehab_opt.session.files import load_problem
from tests.conftest import one_at_a_time
from tests.export.assisting import FORCES, exported_to
from tests.export.calling_c import ROBOT, SECONDS, Built, Exported
from tests.export.pairing import SIDES, exported_side_to

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-misleading-indentation")
"""All but one that takes a third of the compiler's time; `compiled_once` asks for it."""
ARITHMETIC = ("-fno-math-errno", "-ffp-contract=off")

ALONE = {"pose_tracker": ROBOT, "mirror_tracker": "mirror/pick_fruit"}
"""Controllers of a problem that has one, with that problem."""

CHAIR = """
system = "ardis"
title = "out of a corner and up"
[stick]
mecanum = "stick.csv"
differential = "stick.csv"
[room]
walls = [{ normal = [1.0, 0.0], offset_m = 1.2 }]
posts = [{ centre_m = [0.2, 1.0], radius_m = 0.2 }]
"""
STICK = """t_s,forward,left,switch,gripper
0,0,0,0,0
0.2,1,0.3,0,0
1.8,0,0,0,0
2,0,0,1,0
2.1,0,0,0,0
2.3,0.8,-0.6,0,0
3.2,0,0,0,0
3.4,0,0,1,0
3.5,0,0,0,0
3.7,-0.5,1,0,0
4.6,0,0,0,0
"""


@pytest.fixture(scope="session")
def c_compiler() -> str:
    """Path of a C compiler; the test is skipped where there is none."""
    found = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler (gcc, cc, clang) is installed")
    return found


@pytest.fixture(scope="session")
def chair(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A short problem of chair and arm, with both sets of rows, a wall and a post."""
    folder = tmp_path_factory.mktemp("chair")
    (folder / "stick.csv").write_text(STICK)
    (folder / "chair.toml").write_text(CHAIR)
    return str(folder / "chair.toml")


@pytest.fixture(scope="session")
def exported(among_workers: Path, chair: str) -> Exported:
    """C files of a controller: `pose_tracker`, `redundancy_DRIVE`, `mirror_tracker`, or one of `FORCES` or `SIDES`.

    Written once in a run.
    """

    def folder(name: str) -> Path:
        of_the_chair = name not in {*ALONE, *FORCES, *SIDES}
        made = among_workers / ("chair" if of_the_chair else name)
        with one_at_a_time(made.with_suffix(".lock")):
            if not made.exists():
                half = made.with_suffix(".half")
                if name in FORCES:
                    exported_to(half, FORCES[name])
                elif name in SIDES:
                    exported_side_to(half, name)
                else:
                    export_c(load_problem(ALONE.get(name, chair)), half)
                half.rename(made)
        return made / name if of_the_chair else made

    return folder


@pytest.fixture(scope="session")
def built(c_compiler: str, among_workers: Path) -> Built:
    """Compile files of a folder, with the flags of the project's CMake file and more, into a product beside them."""

    def product(folder: Path, name: str, *files: str, flags: tuple[str, ...] = (), by: str = "") -> Path:
        with one_at_a_time(among_workers / f"{'_'.join(folder.parts[-3:])}_{name}.lock"):
            if not (folder / name).exists():
                command = [by or c_compiler, *WARNINGS, *ARITHMETIC, *flags, *files, "-o", name, "-lm"]
                done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=SECONDS)
                assert done.returncode == 0, done.stderr
        return folder / name

    return product
