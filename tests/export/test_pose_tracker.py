"""The tracker in C commands what it commands in Python, whatever it is told, with no memory but its own."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import PoseTracker
from rehab_opt.control.command import Command
from rehab_opt.export.reasons import REASONS, reason_number
from rehab_opt.export.recording import STATUSES
from rehab_opt.optim.qrqp import QRQP_ITERATIONS
from rehab_opt.session.files import load_problem
from rehab_opt.session.pose_tracking.robot import robot_at_start, tracker_of
from tests.export.conftest import ran

PROBLEM = "robot/ur5_circle"
SOURCES = ("rehab_pose_tracker.c", "main.c")
SAME = 1e-9
Built = Callable[..., Path]
Exported = Callable[[str], Path]


class CCommand(ctypes.Structure):
    """`rehab_command`."""

    _fields_ = [
        ("value", ctypes.c_double * 8),
        ("wheels", ctypes.c_double * 4),
        ("scale", ctypes.c_double),
        ("residual", ctypes.c_double),
        *((name, ctypes.c_int) for name in ("status", "yielded", "reason", "solver", "input", "element")),
    ]


class CTracker:
    """The C tracker, called from Python."""

    def __init__(self, library: ctypes.CDLL, *, initialise: bool = True) -> None:
        library.tracker_size.restype = ctypes.c_size_t
        self.library, self.memory = library, ctypes.create_string_buffer(library.tracker_size())
        if initialise:
            assert library.rehab_pose_tracker_init(self.memory) == 0

    def reset(self, velocity: np.ndarray | None) -> int:
        return int(self.library.rehab_pose_tracker_reset(self.memory, _doubles(velocity)))

    def step(self, q: Any, pose: Any, twist: Any, *, enable: int, stamp: float) -> CCommand:
        out = CCommand()
        self.library.rehab_pose_tracker_step(
            self.memory, _doubles(q), _doubles(pose), _doubles(twist), enable, ctypes.c_double(stamp), ctypes.byref(out)
        )
        return out


def _doubles(values: Any) -> Any:
    if values is None:
        return None
    flat = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
    return (ctypes.c_double * flat.size)(*flat)


@pytest.fixture(scope="module")
def library(exported: Exported, built: Built) -> ctypes.CDLL:
    folder = exported(PROBLEM)
    (folder / "size.c").write_text(
        '#include <stddef.h>\n#include "rehab_pose_tracker.h"\nsize_t tracker_size(void);\n'
        "size_t tracker_size(void) { return sizeof(rehab_pose_tracker); }\n"
    )
    files = ("rehab_pose_tracker.c", "size.c")
    return ctypes.CDLL(str(built(folder, "tracker.so", *files, flags=("-O1", "-shared", "-fPIC"))))


@pytest.fixture(scope="module")
def tracker() -> PoseTracker:
    """The same controller in Python, with the rungs that C has."""
    loaded = load_problem(PROBLEM)
    robot, _ = robot_at_start(loaded.problem.robot, file=PROBLEM)
    return tracker_of(loaded.problem, robot, file=PROBLEM, backup="qrqp")


def assert_same(answer: CCommand, command: Command, tolerance: float = SAME) -> None:
    np.testing.assert_allclose(answer.value[:6], command.value, rtol=0, atol=tolerance)
    assert answer.value[6:] == [0.0, 0.0]
    assert abs(answer.scale - command.scale) <= tolerance
    assert (answer.status, answer.yielded) == (STATUSES[command.status], int(command.yielded))
    assert answer.reason == reason_number(command.reason), (REASONS[answer.reason], command.reason)
    assert answer.residual == pytest.approx(command.residual, abs=SAME)


# --------------------------------------------------------------------------------------------------- the recorded run
def test_it_builds_with_warnings_as_errors_and_repeats_the_recorded_run(exported: Exported, built: Built) -> None:
    done = ran(built(exported(PROBLEM), "example", *SOURCES, flags=("-O2",)), "1")
    assert done.returncode == 0, done.stdout
    difference = re.match(r"(\d+) ticks, largest difference from Python (\S+)", done.stdout)
    assert difference is not None
    assert int(difference[1]) > 1000
    assert float(difference[2]) <= SAME
    assert "ticks/s" in done.stdout
    assert "p99.9" in done.stdout


def test_the_recorded_run_is_clean_under_sanitizers(exported: Exported, built: Built) -> None:
    flags = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    done = ran(built(exported(PROBLEM), "sanitized", *SOURCES, flags=flags), "0")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_changed_command_is_found(exported: Exported, built: Built, tmp_path: Path) -> None:
    """The comparison can fail: a hundred-millionth of a rad/s is enough."""
    folder = exported(PROBLEM)
    header = (folder / "recorded_run.h").read_text()
    lines = header.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("    {{")) + 1500
    before, _, after = lines[at].rpartition("}, {0.0}, ")
    begin = before.rindex("{") + 1
    first, _, others = before[begin:].partition(", ")
    lines[at] = f"{before[:begin]}{float(first) + 1e-8!r}, {others}}}, {{0.0}}, {after}"
    for name in ("rehab_pose_tracker.c", "rehab_pose_tracker.h", "main.c"):
        (tmp_path / name).write_text((folder / name).read_text())
    (tmp_path / "recorded_run.h").write_text("\n".join(lines))
    done = ran(built(tmp_path, "changed", *SOURCES, flags=("-O1",)), "0")
    assert done.returncode == 1
    assert "in tick 1500" in done.stdout


def test_the_recorded_run_has_every_kind_of_fault(exported: Exported) -> None:
    header, *rows = (exported(PROBLEM) / "recorded_run.csv").read_text().splitlines()
    at = header.split(",").index("reason")
    met = {REASONS[int(row.split(",")[at])].name for row in rows}
    assert met == {reason.name for reason in REASONS if reason.python is not None} - {
        "NOT_CERTIFIED", "ROWS_DEPENDENT",
    } | {"FINE"}  # fmt: skip


# --------------------------------------------------------------------------------------------------- memory
def test_nothing_is_allocated_shared_or_visible_but_the_interface(
    exported: Exported, built: Built, c_compiler: str
) -> None:
    product = built(exported(PROBLEM), "tracker.o", "-c", "rehab_pose_tracker.c", flags=("-O2",))
    try:
        listed = subprocess.run(["nm", product], capture_output=True, text=True, check=True).stdout
    except FileNotFoundError:
        pytest.skip("nm is not installed")
    symbols = [(line.split()[-2], line.split()[-1]) for line in listed.splitlines()]
    needed = {name for kind, name in symbols if kind == "U"}
    assert not needed & {"malloc", "calloc", "realloc", "free", "printf", "alloca"}
    assert needed <= {
        "memcpy",
        "memset",
        "memmove",
        "sin",
        "cos",
        "atan2",
        "sqrt",
        "floor",
        "sincos",
        "_GLOBAL_OFFSET_TABLE_",
    }
    visible = {name for kind, name in symbols if kind.isupper() and kind != "U"}
    assert visible == {f"rehab_pose_tracker_{name}" for name in ("init", "reset", "step")}
    changeable = [name for kind, name in symbols if kind in "bBdDC" and not name.startswith(("LAW", "asked"))]
    assert changeable == []


def test_two_instances_are_independent(library: ctypes.CDLL, tracker: PoseTracker) -> None:
    """One is led, the other is told nonsense between its ticks: the first never notices."""
    rng = np.random.default_rng(1)
    q, alone, led, other = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), *(CTracker(library) for _ in range(3))
    for k in range(50):
        pose, twist = tracker.chain.pose(q), rng.normal(size=6) * 0.1
        expected = alone.step(q, pose, twist, enable=1, stamp=0.001 * k)
        other.step(rng.normal(size=6), pose * rng.normal(), 1e3 * rng.normal(size=6), enable=k % 3, stamp=rng.normal())
        answer = led.step(q, pose, twist, enable=1, stamp=0.001 * k)
        assert bytes(answer) == bytes(expected)
        q = q + 0.001 * np.array(answer.value[:6])


# --------------------------------------------------------------------------------------------------- any input
def state(rng: np.random.Generator, tracker: PoseTracker) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A position within or somewhat beyond its limits, a pose near or far from it, a twist small or large."""
    chain = tracker.chain
    q = rng.uniform(chain.lower, chain.upper) * rng.choice([0.3, 1.0, 1.01])
    pose = chain.pose(q + rng.normal(size=6) * rng.choice([1e-5, 1e-2, 1.0]))
    return q, pose, rng.normal(size=6) * rng.choice([0.0, 0.1, 10.0])


@settings(max_examples=150)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_states_give_the_commands_of_python(library: ctypes.CDLL, tracker: PoseTracker, seed: int) -> None:
    rng = np.random.default_rng(seed)
    c, stamp = CTracker(library), 0.0
    speed = rng.uniform(-1, 1, 6) * tracker.chain.velocity
    tracker.reset(speed)
    assert c.reset(speed) == 0
    for _ in range(8):
        q, pose, twist = state(rng, tracker)
        for array in (q, pose, twist):
            if rng.random() < 0.03:
                array.flat[rng.integers(array.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e7, -9e5])
        stamp += rng.choice(
            [0.001, 0.001, 0.001, 0.002, 0.0, -0.001, 0.2, np.nan], p=[0.3, 0.3, 0.3, 0.02, 0.02, 0.02, 0.02, 0.02]
        )
        told = {"enable": int(rng.choice([1, 1, 1, 1, 1, 1, 0, -1])), "stamp": float(stamp)}
        assert_same(c.step(q, pose, twist, **told), tracker.step(q, pose, twist, **told))
        stamp = 0.0 if np.isnan(stamp) else stamp


@settings(max_examples=200)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_safe_command_is_the_one_of_python(library: ctypes.CDLL, tracker: PoseTracker, seed: int) -> None:
    rng = np.random.default_rng(seed)
    c, speed = CTracker(library), rng.uniform(-1, 1, 6) * tracker.chain.velocity
    tracker.reset(speed)
    c.reset(speed)
    q, pose, twist = state(rng, tracker)
    q[rng.integers(6)] = rng.choice([np.nan, q[0], 1e300])
    for k in range(3):
        told = {"enable": 0, "stamp": 0.001 * k}
        assert_same(c.step(q, pose, twist, **told), tracker.step(q, pose, twist, **told), tolerance=1e-12)


def test_an_input_that_is_not_there_is_named(library: ctypes.CDLL, tracker: PoseTracker) -> None:
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    pose = tracker.chain.pose(q)
    pose[1, 2] = np.nan
    holes = [((None, pose, np.zeros(6)), (0, 0)), ((q, None, np.zeros(6)), (1, 0)), ((q, pose, np.zeros(6)), (1, 6))]
    for inputs, where in holes:
        answer = CTracker(library).step(*inputs, enable=1, stamp=0.0)
        assert REASONS[answer.reason].name == "INPUT_UNUSABLE"
        assert (answer.input, answer.element) == where
        assert list(answer.value) == [0.0] * 8


def test_a_tracker_that_was_not_initialised_holds(library: ctypes.CDLL) -> None:
    tracker = CTracker(library, initialise=False)
    answer = tracker.step(np.zeros(6), np.eye(4), np.ones(6), enable=1, stamp=0.0)
    assert (REASONS[answer.reason].name, answer.status, list(answer.value)) == ("NOT_INITIALISED", 3, [0.0] * 8)
    assert tracker.reset(np.zeros(6)) == 1


def test_a_speed_beyond_its_limit_is_refused(library: ctypes.CDLL, tracker: PoseTracker) -> None:
    for bad in (1.01 * tracker.chain.velocity, np.full(6, np.nan)):
        assert CTracker(library).reset(bad) == 1


# --------------------------------------------------------------------------------------------------- what is stated
def test_cap_and_licence_are_those_of_the_generated_code(exported: Exported) -> None:
    folder = exported(PROBLEM)
    source, readme = (folder / "rehab_pose_tracker.c").read_text(), (folder / "README.md").read_text()
    caps = {int(cap) for cap in re.findall(r"max_iter = (\d+);\s*/?", source)} - {
        1000
    }  # CasADi's own, replaced at once
    assert caps == {QRQP_ITERATIONS}
    assert f"at most {QRQP_ITERATIONS} times a solve" in readme
    for text in (source, readme):
        assert "permissively licensed (MIT-0)" in text
        assert "Apache-2.0" in text
        assert "not a medical device" in text
    assert "LGPL 3" in readme


def test_cmake_builds_it_and_its_test_passes(exported: Exported, c_compiler: str) -> None:
    cmake = shutil.which("cmake")
    if cmake is None:
        pytest.skip("cmake is not installed")
    folder = exported(PROBLEM)
    for arguments in (["-S", ".", "-B", "build"], ["--build", "build"]):
        done = subprocess.run([cmake, *arguments], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert ran(folder / "build" / "example", "0").returncode == 0
