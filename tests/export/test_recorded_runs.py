"""Every exported controller builds without a warning, repeats its recorded run, and has no memory but its own."""

from __future__ import annotations

import csv
import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import PoseTracker, ur5
from rehab_opt.control.reasons import REASONS
from rehab_opt.optim.qrqp import QRQP_ITERATIONS
from tests.export.assisting import FORCES
from tests.export.calling_c import SAME, Built, Exported, compiled_once, difference_told, ran
from tests.export.pairing import SIDES
from tests.failing_solvers import failing_solvers

CONTROLLERS = ("pose_tracker", "redundancy_mecanum", "redundancy_differential", "mirror_tracker", *FORCES, *SIDES)
ORDINARY = ("pose_tracker", "redundancy_differential", "assistance")
"""One of joint velocities, one with laws to change between, one of forces; the others are nightly."""
CHOSEN = [each if each in ORDINARY else pytest.param(each, marks=pytest.mark.nightly) for each in CONTROLLERS]
INTERFACE = {
    "pose_tracker": ("init", "reset", "step"),
    "mirror_tracker": ("get_following", "init", "reset", "step"),
    "assistance": ("set_field", "shift", "energy_left", "init", "reset", "step"),
    "path_assistance": ("energy_left", "init", "progress", "reset", "step"),
    **dict.fromkeys(SIDES, ("energy_left", "init", "reset", "step")),
}
OF_A_ROOM = ("free", "init", "post", "reset", "step", "wall")
LIBRARY = {
    "acos", "atan2", "cos", "exp", "fabs", "floor", "hypot", "log", "memcpy", "memmove", "memset", "sin", "sincos",
    "sqrt",
}  # fmt: skip
"""Of C, and all that is needed."""
SANITIZED = (
    "-O0", "-fsanitize=address,undefined", "-fsanitize-undefined-trap-on-error",
    "--param=asan-instrumentation-with-call-threshold=0",
)  # fmt: skip
"""Every check, but as a call or a trap that only ends the program: their text would double the compiler's time."""


@pytest.mark.parametrize("name", CHOSEN)
def test_it_repeats_the_recorded_run_clean_under_sanitizers(name: str, exported: Exported, built: Built) -> None:
    done = ran(built(exported(name), "sanitized", f"rehab_{name}.c", "main.c", flags=SANITIZED), "0")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert int(re.match(r"(\d+) ticks, ", done.stdout)[1]) > 500  # type: ignore[index]
    assert difference_told(done) <= SAME


@pytest.mark.nightly
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("level", ["-O2", "-O3"])
@pytest.mark.parametrize("name", CONTROLLERS)
def test_it_builds_with_warnings_as_errors_by_gcc_and_clang(
    name: str, level: str, compiler: str, exported: Exported, built: Built
) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    flags, program = (level, "-Wmisleading-indentation"), f"optimised_{compiler}{level}"
    done = ran(built(exported(name), program, f"rehab_{name}.c", "main.c", flags=flags, by=compiler), "1")
    assert difference_told(done) <= SAME
    assert "ticks/s" in done.stdout
    assert "p99.9" in done.stdout


@pytest.mark.parametrize("name", CHOSEN)
def test_the_files_tell_the_backup_that_c_has_not_the_cap_and_the_licence(name: str, exported: Exported) -> None:
    source, header, readme = (
        (exported(name) / file).read_text() for file in (f"rehab_{name}.c", f"rehab_{name}.h", "README.md")
    )
    caps = {int(found) for found in re.findall(r"max_iter = (\d+);", source)}
    solves = name not in {*FORCES, *SIDES}
    assert caps == ({1000, QRQP_ITERATIONS} if solves else set())  # CasADi sets its own first
    header, readme = (" ".join(text.replace("*", " ").split()) for text in (header, readme))
    effort = f"solves of {QRQP_ITERATIONS} changes of the active set" if solves else "solves no QP by iterations"
    assert effort in header
    with failing_solvers() as failures:
        tracker = PoseTracker(ur5(), compile=False)
    failures.primary = True
    backup = tracker.step(np.zeros(6), ur5().pose(np.zeros(6)), np.zeros(6)).solver
    for words in (
        effort,
        f"There is no backup solver. Where Python would use {backup}, C",
        "`REHAB_OK`, `REHAB_BACKUP` and `REHAB_BLOCKED` are certified",
        "permissively licensed (MIT-0)",
        "LGPL 3",
    ):
        assert words in readme
    _, *functions = source.split("\nstatic int casadi_f")  # of a chair the two laws share most
    texts = [each.partition("(")[2].partition("\n}\n")[0] for each in functions]
    assert len(set(texts)) == len(texts) > 3


@pytest.mark.parametrize(
    "name", ["pose_tracker", "redundancy_differential", pytest.param("mirror_tracker", marks=pytest.mark.nightly)]
)
def test_half_of_the_recorded_run_has_encoders_with_noise(name: str, exported: Exported) -> None:
    with (exported(name) / "recorded_run.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    q = np.array([[float(row[key]) for key in row if key.startswith("q_")] for row in rows])
    bends = np.abs(q[2:] - 2 * q[1:-1] + q[:-2]) / math.sqrt(6.0)  # of white noise, as large as itself
    moves = bends.max(axis=1) > 0  # which encoders that stand still, at the end, do not
    valid = bends[moves]
    quiet, noisy = np.nanmedian(valid[: len(valid) // 3], axis=0), np.nanmedian(valid[2 * len(valid) // 3 :], axis=0)
    assert np.median(quiet) < 2e-5
    assert 5e-5 < noisy.min() <= noisy.max() < 1e-4
    certified = np.array([float(row["scale"]) > 0 for row in rows])[1:-1][moves]
    assert np.mean(certified[2 * len(valid) // 3 :]) > 0.85  # among some twenty ticks with faults


@pytest.mark.parametrize("flag", ["-ffinite-math-only", "-fsingle-precision-constant"])
def test_it_does_not_compile_where_its_checks_would_not_hold(flag: str, exported: Exported, c_compiler: str) -> None:
    """Arithmetic without NaN lets a broken sensor pass."""
    if flag == "-fsingle-precision-constant" and "clang" in Path(c_compiler).resolve().name:
        pytest.skip("clang has no such flag for C")
    command = [c_compiler, "-std=c99", "-fsyntax-only", flag, "rehab_pose_tracker.c"]
    done = subprocess.run(command, cwd=exported("pose_tracker"), capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "a wrong command hurts someone" in done.stderr or "constants_are_no_doubles" in done.stderr
    plain = [part for part in command if part != flag]
    assert subprocess.run(plain, cwd=exported("pose_tracker"), capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize("name", CHOSEN)
def test_the_recorded_run_has_the_faults_of_every_tick(name: str, exported: Exported) -> None:
    header, *rows = (exported(name) / "recorded_run.csv").read_text().splitlines()
    at = header.split(",").index("reason")
    met = {REASONS[int(row.split(",")[at])].name for row in rows}
    assert met >= {
        "FINE", "NOT_ENABLED", "STAMP_NOT_FINITE", "STAMP_GAP", "STAMP_BACKWARDS", "STAMP_REPEATED", "STATE_STALE",
    }  # fmt: skip
    of_numbers = {"POSITION_INVALID", "VELOCITY_INVALID", "HAND_TOO_FAST", "POSITION_JUMPED"}
    if name == "mirror_tracker":
        of_numbers = {"INPUT_INVALID"}  # of what is too large together the pose is not rigid, which it looks at first
    others = {*FORCES, *SIDES, "mirror_tracker"}
    assert met >= (of_numbers if name in others else {"INPUT_INVALID", "INPUT_TOO_LARGE"})
    assert ("POSE_NOT_RIGID" in met) == (name in ("pose_tracker", "mirror_tracker"))
    assert ("FORCE_AT_LIMIT" in met) == (name == "mirror_tracker")


@pytest.mark.parametrize("name", CHOSEN)
def test_nothing_is_allocated_shared_or_visible_but_the_interface(name: str, exported: Exported, built: Built) -> None:
    folder = exported(name)
    product = compiled_once(folder, name, built)
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    listed = subprocess.run(["nm", product], cwd=folder, capture_output=True, text=True, check=True).stdout
    symbols = [(line.split()[-2], line.split()[-1]) for line in listed.splitlines()]
    assert {symbol for kind, symbol in symbols if kind == "U"} <= LIBRARY | {"_GLOBAL_OFFSET_TABLE_"}
    visible = {symbol for kind, symbol in symbols if kind.isupper() and kind != "U"}
    assert visible == {f"rehab_{name}_{each}" for each in INTERFACE.get(name, OF_A_ROOM)}
    # Tables of addresses count as data where code may be placed anywhere; both are const.
    changeable = {re.sub(r"\.\d+$", "", symbol) for kind, symbol in symbols if kind in "bBdDC"}
    assert changeable <= {"LAW", "asked"}


@pytest.mark.nightly
def test_cmake_builds_it_and_its_test_passes(exported: Exported, c_compiler: str) -> None:
    cmake = shutil.which("cmake")
    if cmake is None:
        pytest.skip("cmake is not installed")
    folder = exported("pose_tracker")
    for arguments in (["-S", ".", "-B", "build"], ["--build", "build"]):
        done = subprocess.run([cmake, *arguments], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert ran(folder / "build" / "example", "0").returncode == 0
