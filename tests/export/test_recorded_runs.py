"""Every exported controller builds without a warning, repeats its recorded run, and has no memory but its own."""

from __future__ import annotations

import csv
import math
import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import JointFeedback, PoseTracker, ur5
from rehab_opt.control.reasons import REASONS
from rehab_opt.export.recording import Joints
from rehab_opt.optim.qrqp import QRQP_ITERATIONS
from tests.export.assisting import FORCES
from tests.export.calling_c import SAME, Built, Exported, compiled_once, ran
from tests.export.pairing import SIDES
from tests.failing_solvers import failing_solvers

CONTROLLERS = ("pose_tracker", "redundancy_mecanum", "redundancy_differential", "mirror_tracker", *FORCES, *SIDES)
COMPILED = ("pose_tracker", "redundancy_differential", "assistance")
CHOSEN = [
    each
    if each in ("pose_tracker", "redundancy_differential", "assistance")
    else pytest.param(each, marks=pytest.mark.nightly)
    for each in CONTROLLERS
]
"""Compiled as a user's; the sanitised build of each of the others repeats its run, too."""
SANITISED = [
    pytest.param(each, marks=pytest.mark.nightly) if each in ("mirror_tracker", "helper_side") else each
    for each in CONTROLLERS
    if each != "redundancy_mecanum"  # one drive stands for both
]
INTERFACE = {
    "pose_tracker": ("init", "reset", "step"),
    "mirror_tracker": ("get_following", "init", "reset", "step"),
    "assistance": ("set_field", "shift", "energy_left", "init", "reset", "step"),
    "path_assistance": ("energy_left", "init", "progress", "reset", "step"),
    **dict.fromkeys(SIDES, ("energy_left", "init", "reset", "step")),
}
OF_A_ROOM = ("free", "init", "post", "reset", "step", "wall")
LIBRARY = {
    "acos",
    "memcpy",
    "memset",
    "memmove",
    "sin",
    "cos",
    "sincos",
    "atan2",
    "sqrt",
    "floor",
    "hypot",
    "exp",
    "log",
    "fabs",
}
"""Of C, and all that is needed."""
SANITIZED = (
    "-O0", "-fsanitize=address,undefined", "-fsanitize-undefined-trap-on-error",
    "--param=asan-instrumentation-with-call-threshold=0",
)  # fmt: skip
"""Every check, but as a call or a trap that only ends the program: their text would double the compiler's time."""


@pytest.mark.parametrize("servo_hz", [24.0])
def test_joints_of_a_recorded_run_are_late_by_the_delay_to_the_fraction_of_a_tick(servo_hz: float) -> None:
    """Two ticks and a half are five of half a tick."""
    feedback, start, rng = JointFeedback(delay=0.025, servo_hz=servo_hz), np.zeros(3), np.random.default_rng(1)
    whole = Joints(start, dt=0.01, ticks=600, feedback=feedback, base=1)
    halves = Joints(start, dt=0.005, ticks=600, feedback=feedback, base=1)
    for _ in range(100):
        command = rng.normal(size=3)
        whole.go(command)
        halves.go(command)
        halves.go(command)
        np.testing.assert_allclose(whole.seen(start), halves.seen(start), rtol=0, atol=1e-12)
    assert np.abs(whole.seen(start)).min() > 0.01


@pytest.mark.parametrize("name", CHOSEN)
def test_it_builds_with_warnings_as_errors_and_repeats_the_recorded_run(
    name: str, exported: Exported, built: Built
) -> None:
    folder = exported(name)
    product = compiled_once(folder, name, built)
    if name not in COMPILED:  # at night, at the CMake file's level
        flags = ("-O2", "-fPIC", "-Wmisleading-indentation")
        product = built(folder, "optimised.o", "-c", f"rehab_{name}.c", flags=flags).name
    done = ran(built(folder, "repeated", product, "main.c", flags=("-O2",)), "1")
    assert done.returncode == 0, done.stdout
    difference = re.match(r"(\d+) ticks, largest difference from Python (\S+)", done.stdout)
    assert difference is not None
    assert int(difference[1]) > 500
    assert float(difference[2]) <= SAME
    assert "ticks/s" in done.stdout
    assert "p99.9" in done.stdout


@pytest.mark.parametrize("name", SANITISED)
def test_the_recorded_run_is_clean_under_sanitizers(name: str, exported: Exported, built: Built) -> None:
    done = ran(built(exported(name), "sanitized", f"rehab_{name}.c", "main.c", flags=SANITIZED), "0")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert float(done.stdout.split("largest difference from Python ")[1].split()[0]) <= SAME


@pytest.mark.parametrize("name", ["pose_tracker", "redundancy_mecanum"])
def test_the_recorded_run_has_joints_that_do_not_follow_until_the_enable_input_is_released(
    name: str, exported: Exported
) -> None:
    with (exported(name) / "recorded_run.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    reasons = [REASONS[int(row["reason"])].name for row in rows]
    moved = [k for k, (row, after) in enumerate(pairwise(rows)) if row["q_3"] != after["q_3"]]
    lost = [k for k, reason in enumerate(reasons) if reason == "NOT_FOLLOWED"]
    assert lost
    assert reasons[-1] == "NOT_ENABLED"
    assert moved[-1] < lost[0]


@pytest.mark.parametrize("name", ["pose_tracker", "redundancy_mecanum", "mirror_tracker"])
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
    assert np.mean(certified[2 * len(valid) // 3 :]) > 0.9


def test_a_changed_number_beside_the_command_is_found(exported: Exported, built: Built, tmp_path: Path) -> None:
    """The comparison can fail for what is said besides, too: here for the progress along the path."""
    name = "path_assistance"
    folder = exported(name)
    lines = (folder / "recorded_run.h").read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("    {{")) + 700
    before, value, after = lines[at].rpartition("}, {0.0}, ")
    before, command, values = before.rpartition("}, {")
    before, comma, progress = before.rpartition(", ")
    lines[at] = f"{before}{comma}{float(progress) + 1e-8!r}{command}{values}{value}{after}"
    for file in (compiled_once(folder, name, built), f"rehab_{name}.h", "main.c"):
        (tmp_path / file).write_bytes((folder / file).read_bytes())
    (tmp_path / "recorded_run.h").write_text("\n".join(lines))
    done = ran(built(tmp_path, "changed", "controller.o", "main.c"), "0")
    assert done.returncode == 1
    assert "in tick 700" in done.stdout


@pytest.mark.parametrize("name", CHOSEN)
def test_the_backup_that_c_has_not_is_the_one_that_python_has(name: str, exported: Exported) -> None:
    readme = " ".join((exported(name) / "README.md").read_text().split())
    assert "`REHAB_OK`, `REHAB_BACKUP` and `REHAB_BLOCKED` are certified" in readme
    with failing_solvers() as failures:
        tracker = PoseTracker(ur5(), compile=False)
    failures.primary = True
    backup = tracker.step(np.zeros(6), ur5().pose(np.zeros(6)), np.zeros(6)).solver
    assert backup
    assert f"There is no backup solver. Where Python would use {backup}, C" in readme
    assert readme.count("proxqp") == 0


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


@pytest.mark.parametrize("name", CONTROLLERS)
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


@pytest.mark.parametrize("name", CONTROLLERS)
def test_cap_and_licence_are_those_of_the_generated_code(name: str, exported: Exported) -> None:
    folder = exported(name)
    source, readme = (folder / f"rehab_{name}.c").read_text(), (folder / "README.md").read_text()
    header = (folder / f"rehab_{name}.h").read_text()
    caps = {int(found) for found in re.findall(r"max_iter = (\d+);", source)}
    assert caps == {1000, QRQP_ITERATIONS}  # CasADi sets its own first
    for text in (header, readme):
        assert f"at most {QRQP_ITERATIONS} times a solve" in " ".join(text.replace("*", " ").split())
    for text in (source, readme):
        assert "permissively licensed (MIT-0)" in text
        assert "Apache-2.0" in text
        assert "not a medical device" in text
    assert "LGPL 3" in readme


@pytest.mark.parametrize("name", CONTROLLERS)
def test_no_function_is_written_twice(name: str, exported: Exported) -> None:
    """Of a chair, whose two sets of rows share most, that was 1.1 of 2.6 MB."""
    _, *functions = (exported(name) / f"rehab_{name}.c").read_text().split("\nstatic int casadi_f")
    texts = [each.partition("(")[2].partition("\n}\n")[0] for each in functions]
    assert len(texts) > 3
    assert len(set(texts)) == len(texts)


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
