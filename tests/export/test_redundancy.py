"""Chair and arm in C do what they do in Python: rows that change, obstacles that come and go, inputs that are none."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.control.command import Command
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.session.ardis.robot import resolver_of, robot_of
from rehab_opt.session.files import load_problem
from tests.export.calling_c import Built, CCommand, CController, Exported, assert_same, giving_up, shared
from tests.failing_solvers import Failures, failing_solvers

FRAMES = ("chassis", "world")
DT = 0.01


@pytest.fixture(scope="module", params=[pytest.param("mecanum", marks=pytest.mark.nightly), "differential"])
def drive(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def library(drive: str, exported: Exported, built: Built) -> ctypes.CDLL:
    name = f"redundancy_{drive}"
    return shared(exported(name), name, built)


@pytest.fixture(scope="module")
def failures() -> Iterator[Failures]:
    """What fails in `made`."""
    with failing_solvers() as failures:
        yield failures


@pytest.fixture(scope="module")
def made(drive: str, chair: str, failures: Failures) -> RedundancyResolver:
    """The same controller in Python, with the stages that C has."""
    config = load_problem(chair)
    return resolver_of(config, robot_of(config), drive, backup="qrqp")  # type: ignore[arg-type]


@pytest.fixture
def resolver(made: RedundancyResolver, chair: str) -> RedundancyResolver:
    """Made once, new in every test: at rest, in its first rows, in the room of the file."""
    return begun(made)


def begun(made: RedundancyResolver) -> RedundancyResolver:
    made.obstacles = (HalfPlane((1.0, 0.0), 1.2), Disc((0.2, 1.0), 0.2))
    made.reset()
    return made


def python(resolver: RedundancyResolver, q: Any, twist: Any, rows: int, frame: int, **told: Any) -> Command:
    return resolver.step(q, twist, resolver.row_sets[rows], FRAMES[frame], **told)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_motion_gives_the_commands_of_python(
    library: ctypes.CDLL, made: RedundancyResolver, drive: str, seed: int
) -> None:
    """A robot that goes where C sends it, with a stick that jumps, modes that change and sensors that fail."""
    rng, resolver, c = np.random.default_rng(seed), begun(made), CController(library, f"redundancy_{drive}")
    q, stamp, rows, frame = np.array(ARDIS_READY) + 0.2 * rng.normal(size=7), 0.0, 0, 0
    twist = np.zeros(2)
    for _ in range(25):
        if rng.random() < 0.2:
            rows, frame = int(rng.integers(2)), int(rng.integers(2))
        if rng.random() < 0.3:
            twist = rng.normal(size=2) * rng.choice([0.0, 0.1, 1.0])
        seen, asked = q.copy(), twist.copy()
        if rng.random() < 0.05:
            target = rng.choice([0, 1])
            (seen, asked)[target].flat[rng.integers(2)] = rng.choice([np.nan, np.inf, -np.inf, 1e7, -9e5])
        stamp += DT if rng.random() < 0.95 else rng.choice([0.02, 0.0, -DT, 0.2, -0.2])
        told = {"enable": int(rng.random() < 0.95), "stamp": stamp}
        answer = c.step(seen, asked, rows, frame, **told)
        assert_same(answer, python(resolver, seen, asked, rows, frame, **told))
        q = q + DT * np.array(answer.value[:7])


@pytest.mark.nightly
def test_where_the_solver_writes_nothing_the_law_is_slowed_into_its_bounds(
    drive: str, exported: Exported, built: Built, resolver: RedundancyResolver, failures: Failures
) -> None:
    """As in Python: certified, and no worse than that; and the safe command where the bounds leave nothing of it."""
    name = f"redundancy_{drive}"
    library = giving_up(exported(name), name, built, "law_0_tick", "law_1_tick")
    c, q, met, rng = CController(library, name), np.array(ARDIS_READY), set(), np.random.default_rng(3)
    rows, twist = 0, np.array([0.2, 0.1])
    for k in range(300):
        if k % 20 == 0:
            rows, twist = int(rng.integers(2)), rng.normal(size=2) * 0.2
        failures.primary, told = bool(rng.random() < 0.5), {"enable": 1, "stamp": DT * k}
        library.give_up(int(failures.primary))
        answer = c.step(q, twist, rows, 0, **told)
        assert_same(answer, python(resolver, q, twist, rows, 0, **told))
        met.add((answer.status, answer.why))
        q = q + DT * np.array(answer.value[:7])
    assert (1, "NOT_CERTIFIED") in met
    failures.primary = False


def test_obstacles_may_change_between_ticks(library: ctypes.CDLL, resolver: RedundancyResolver, drive: str) -> None:
    c, q = CController(library, f"redundancy_{drive}"), np.array(ARDIS_READY)
    rooms = (
        ([("wall", 3.0, 4.0, 2.0), ("free",)], (HalfPlane((3.0, 4.0), 2.0),)),
        ([("post", 0.9, 0.1, 0.3), ("wall", -1.0, 0.0, 0.6)], (Disc((0.9, 0.1), 0.3), HalfPlane((-1.0, 0.0), 0.6))),
        ([("free",), ("free",)], ()),
    )
    for k in range(90):
        if k % 30 == 0:
            calls, obstacles = rooms[k // 30]
            assert [c.call(kind, place, *numbers) for place, (kind, *numbers) in enumerate(calls)] == [0, 0]
            resolver.obstacles = obstacles
        told = {"enable": 1, "stamp": DT * k}
        answer = c.step(q, [0.2, 0.1], 0, 0, **told)
        assert_same(answer, python(resolver, q, [0.2, 0.1], 0, 0, **told))
        q = q + DT * np.array(answer.value[:7])


def test_obstacles_that_are_none_are_refused(library: ctypes.CDLL, drive: str) -> None:
    c = CController(library, f"redundancy_{drive}")
    nan = float("nan")
    refused = [
        ("wall", 0, 0.0, 0.0, 1.0), ("wall", 0, nan, 1.0, 1.0), ("wall", 0, 1.0, 0.0, nan), ("wall", 2, 1.0, 0.0, 1.0),
        ("post", -1, 0.0, 0.0, 1.0), ("post", 0, nan, 0.0, 1.0), ("post", 0, 0.0, 0.0, -0.1), ("free", 2),
    ]  # fmt: skip
    assert [c.call(*each) for each in refused] == [1] * len(refused)
    assert c.call("reset", nan) == 1


def test_rows_that_it_was_not_made_for_brake(library: ctypes.CDLL, drive: str) -> None:
    c, q, answer = CController(library, f"redundancy_{drive}"), np.array(ARDIS_READY), CCommand()
    for k in range(20):
        answer = c.step(q, [0.2, 0.0], 0, 0, enable=1, stamp=DT * k)
        q = q + DT * np.array(answer.value[:7])
    fast = np.abs(answer.value[:7]).max()
    for rows, frame in ((2, 0), (-1, 0), (0, 2)):
        answer = c.step(q, [0.2, 0.0], rows, frame, enable=1, stamp=0.2)
        assert (answer.why, answer.status) == ("ROWS_UNKNOWN", 2)
        assert np.abs(answer.value[:7]).max() < fast
        fast = np.abs(answer.value[:7]).max()
