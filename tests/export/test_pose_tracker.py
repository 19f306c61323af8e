"""The tracker in C commands what it commands in Python, whatever it is told, with no memory but its own."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import PoseTracker
from rehab_opt.session.files import load_problem
from rehab_opt.session.pose_tracking import tracker_of
from rehab_opt.session.robot_file import robot_at_start
from tests.export.calling_c import (
    ROBOT,
    Built,
    CController,
    Exported,
    assert_same,
    compiled_once,
    giving_up,
    ran,
    shared,
)
from tests.failing_solvers import failing_solvers

NAME = "pose_tracker"


@pytest.fixture(scope="module")
def library(exported: Exported, built: Built) -> ctypes.CDLL:
    return shared(exported(NAME), "pose_tracker", built)


@pytest.fixture(scope="module")
def tracker() -> PoseTracker:
    return made()


def made() -> PoseTracker:
    """The same controller in Python, with the stages that C has."""
    config = load_problem(ROBOT)
    robot, _ = robot_at_start(config)
    return tracker_of(config.problem, robot, file=ROBOT, backup="qrqp")


def test_a_changed_command_is_found(exported: Exported, built: Built, tmp_path: Path) -> None:
    """The comparison can fail: a hundred-millionth of a rad/s is enough."""
    folder = exported(NAME)
    header = (folder / "recorded_run.h").read_text()
    lines = header.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("    {{")) + 1500
    before, _, after = lines[at].rpartition("}, {0.0}, ")
    begin = before.rindex("{") + 1
    first, _, others = before[begin:].partition(", ")
    lines[at] = f"{before[:begin]}{float(first) + 1e-8!r}, {others}}}, {{0.0}}, {after}"
    for name in (compiled_once(folder, NAME, built), "rehab_pose_tracker.h", "main.c"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "recorded_run.h").write_text("\n".join(lines))
    done = ran(built(tmp_path, "changed", "controller.o", "main.c"), "0")
    assert done.returncode == 1
    assert "in tick 1500" in done.stdout


def test_two_instances_are_independent(library: ctypes.CDLL, tracker: PoseTracker) -> None:
    """One is led, the other is told nonsense between its ticks: the first never notices."""
    rng = np.random.default_rng(1)
    q, alone, led, other = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), *(CController(library, NAME) for _ in range(3))
    for k in range(50):
        pose, twist = tracker.chain.pose(q), rng.normal(size=6) * 0.1
        expected = alone.step(q, pose, twist, enable=1, stamp=0.001 * k)
        other.step(rng.normal(size=6), pose * rng.normal(), 1e3 * rng.normal(size=6), enable=k % 3, stamp=rng.normal())
        answer = led.step(q, pose, twist, enable=1, stamp=0.001 * k)
        assert bytes(answer) == bytes(expected)
        q = q + 0.001 * np.array(answer.value[:6])


def state(rng: np.random.Generator, tracker: PoseTracker) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A position within or somewhat beyond its limits, a pose near or far from it, a twist small or large."""
    chain = tracker.chain
    q = rng.uniform(chain.lower, chain.upper) * rng.choice([0.3, 1.0, 1.01])
    pose = chain.pose(q + rng.normal(size=6) * rng.choice([1e-5, 1e-2, 1.0]))
    return q, pose, rng.normal(size=6) * rng.choice([0.0, 0.1, 10.0])


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_states_give_the_commands_of_python(library: ctypes.CDLL, tracker: PoseTracker, seed: int) -> None:
    rng = np.random.default_rng(seed)
    c, stamp = CController(library, NAME), 0.0
    speed = rng.uniform(-1, 1, 6) * tracker.chain.velocity
    tracker.reset(speed)
    assert c.call("reset", speed) == 0
    for _ in range(8):
        q, pose, twist = state(rng, tracker)
        for array in (q, pose, twist):
            if rng.random() < 0.03:
                array.flat[rng.integers(array.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e7, -9e5])
        stamp += 0.001 if rng.random() < 0.9 else rng.choice([0.002, 0.0, -0.001, 0.2, -0.2, np.nan])
        told = {"enable": int(rng.choice([1, 1, 1, 1, 1, 1, 0, -1])), "stamp": float(stamp)}
        assert_same(c.step(q, pose, twist, **told), tracker.step(q, pose, twist, **told))
        stamp = 0.0 if np.isnan(stamp) else stamp


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_stamps_are_judged_as_in_python(library: ctypes.CDLL, tracker: PoseTracker, seed: int) -> None:
    """Streams that are slow, late, lost, repeated, reversed and begun anew, for as long as it takes to matter."""
    rng, c, stamp = np.random.default_rng(seed), CController(library, NAME), 0.0
    tracker.reset()
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    pose, twist = tracker.chain.pose(q), np.zeros(6)
    for _ in range(12):
        kind = rng.integers(8)
        for _ in range(int(rng.choice([1, 20, 100]))):
            advance = (0.001, 0.0001, np.nan, 0.0, -0.0005, rng.uniform(0.051, 0.2), 0.002, 0.01)[kind]
            told = {"enable": 1, "stamp": float(stamp + advance)}
            assert_same(c.step(q, pose, twist, **told), tracker.step(q, pose, twist, **told))
            stamp += 0.0 if np.isnan(advance) else advance
        stamp -= rng.choice([0.0, 0.0, 0.0, 1.0])


def test_a_solver_that_writes_nothing_brakes(exported: Exported, built: Built) -> None:
    """What it answered before is not taken for an answer."""
    library = giving_up(exported(NAME), NAME, built, "pose_tracker_tick")
    c, q = CController(library, NAME), np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    with failing_solvers() as failures:
        tracker = made()
    pose, twist = tracker.chain.pose(q), np.array([0.1, 0.0, 0.0, 0.0, 0.2, 0.0])
    for k in range(20):
        told = {"enable": 1, "stamp": 0.001 * k}
        assert_same(c.step(q, pose, twist, **told), tracker.step(q, pose, twist, **told))
    library.give_up(1)
    failures.primary = True
    for k in range(20, 40):
        told = {"enable": 1, "stamp": 0.001 * k}
        answer = c.step(q, pose, twist, **told)
        assert_same(answer, tracker.step(q, pose, twist, **told))
        assert answer.why == "NOT_CERTIFIED"
    library.give_up(0)
    failures.primary = False
    told = {"enable": 1, "stamp": 0.04}
    assert_same(c.step(q, pose, twist, **told), tracker.step(q, pose, twist, **told))
