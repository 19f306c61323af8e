"""The mirror's tracker in C commands what it commands in Python: clock, true bounds, forces, the led arm, faults."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rehab_opt import MirrorTracker
from rehab_opt.control import reference_clock
from rehab_opt.export.controllers.mirror import NAME
from rehab_opt.export.exported import MAX_VALUES
from tests.export.calling_c import Built, giving_up, shared
from tests.export.mirroring import MADE, START, Array, CMirror, Twins, seven_joints, wave, written
from tests.failing_solvers import failing_solvers

FEW = 40
"""Samples that wait at most, here."""
ROOM = "enum { WAITING = "


@pytest.fixture(scope="module", autouse=True)
def little_room() -> Iterator[None]:
    """So that references are often thinned, in both languages."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reference_clock, "THINNED", FEW)
        yield


class Lazy(dict[str, Any]):
    """Values by name, each made when it is first asked for: the nightly arm costs the others nothing."""

    def __init__(self, make: Callable[[str], Any]) -> None:
        self.make = make

    def __missing__(self, name: str) -> Any:
        self[name] = self.make(name)
        return self[name]


@pytest.fixture(scope="module")
def trackers() -> dict[str, MirrorTracker]:
    """In Python, with the stages that C has."""
    return Lazy(lambda name: MADE[name]())


@pytest.fixture(scope="module")
def folders(trackers: dict[str, MirrorTracker], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return Lazy(lambda name: written(tmp_path_factory.mktemp(name), name, trackers[name]))


@pytest.fixture(scope="module")
def libraries(folders: dict[str, Path], built: Built) -> dict[str, ctypes.CDLL]:
    return Lazy(lambda name: shared(folders[name], NAME, built, level="-O0"))


# ------------------------------------------------------------------------------------------------- whatever it is told
def hostile(rng: np.random.Generator, inputs: list[Array]) -> None:
    """One number of them replaced."""
    array = inputs[rng.integers(len(inputs))]
    array.flat[rng.integers(array.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e7, -9e5, 1e300, 0.0, 3.0])


def told(twins: Twins, rng: np.random.Generator, start: Array, ticks: int) -> set[str]:
    """Tell both a run in which much goes wrong; what they said."""
    chain, said, last = twins.python.chain, set(), set()
    spread = rng.choice([0.0, 0.05, 0.5])
    q = rng.choice([1.0, 1.0, 0.0]) * (start + spread * rng.normal(size=chain.n))  # some start singular
    poses, twists = wave(twins.python, q, rng, ticks)
    pushes, rate = rng.random() < 0.4, rng.choice([0.0, 0.0, 0.04])
    for k in range(ticks):
        given = [q.copy(), poses[k].copy(), twists[k].copy()]
        force = rng.normal(size=3) * rng.choice([1.0, 10.0, 30.0]) if pushes and k // 30 % 2 else None
        later, enable = 1.0, 1
        if rng.random() < 0.1 and "step shortened: the bo" in last:
            given[0][:] = np.nan  # then it goes by where the shortened step led
        if rng.random() < rate:
            hostile(rng, given if force is None else [*given, force])
        if rng.random() < rate:
            later, enable = rng.choice([1, 0, -1, 30, np.nan, 2, -400]), int(rng.choice([1, 0, 2, -1]))
        if rng.random() < rate / 2:
            poses[k + 1 :, :3, 3] += 0.1 * rng.normal(size=3)  # a jump of the reference
        if rng.random() < rate / 2:
            q = q + 0.1 * rng.normal(size=chain.n)  # the robot is pushed
        command = twins.step(*given, force, enable=enable, later=later)
        last = {command.status.name, *(part[:22] for part in command.reason.split("; "))}
        said |= last
        q = q + command.value * twins.python.dt
    return said


@pytest.mark.parametrize("name", [pytest.param("led", marks=pytest.mark.nightly), "redundant"])
def test_any_motion_with_faults_and_forces_gives_the_commands_of_python(
    name: str, libraries: dict[str, ctypes.CDLL], trackers: dict[str, MirrorTracker]
) -> None:
    said: set[str] = set()

    @settings(max_examples=12, deadline=None)
    @example(6)  # steps are shortened, of both
    @example(27)  # and here: one of them may change with rounding
    @example(7117)  # a live tick that ends in a fault at rest told the manipulability of the answer that was not taken
    @example(559434)  # tries of the led arm's model that were not taken counted in Python as joints that do not follow
    @given(seed=st.integers(0, 2**32 - 1))
    def run(seed: int) -> None:
        twins = Twins(libraries[name], trackers[name])
        said.update(told(twins, np.random.default_rng(seed), START[name], 120))

    run()
    assert said >= {"OK", "BRAKING", "step shortened: the bo", "the reference is follo", "bridging a jump of the"}


def test_samples_that_do_not_fit_are_thinned_alike(
    libraries: dict[str, ctypes.CDLL], trackers: dict[str, MirrorTracker]
) -> None:
    """A hand that runs away for longer than there is room, comes to rest, and is caught up with."""
    tracker = trackers["redundant"]
    twins, q, dt = Twins(libraries["redundant"], tracker), START["redundant"], tracker.dt
    pose, most = tracker.chain.pose(q), 0.0
    for k in range(700):
        going = 30 <= k < 130
        pose = pose.copy()
        pose[1, 3] += 0.5 * dt * np.cos(0.05 * k) * going
        command = twins.step(q, pose, np.array([0, 0.5 * np.cos(0.05 * k) * going, 0, 0, 0, 0]))
        q = q + command.value * dt
        most = max(most, tracker.lag)
        assert tracker.clock.waiting < FEW
    assert most > FEW * dt
    assert tracker.lag < 2 * dt
    assert np.linalg.norm(tracker.chain.pose(q)[:3, 3] - pose[:3, 3]) < 1e-3


# ------------------------------------------------------------------------------------------------------- the interface
def test_a_reset_forgets_everything(libraries: dict[str, ctypes.CDLL], trackers: dict[str, MirrorTracker]) -> None:
    name = "redundant"
    tracker = trackers[name]
    used, fresh = Twins(libraries[name], tracker), CMirror(libraries[name])
    told(used, np.random.default_rng(3), START[name], 150)
    velocity = 0.2 * tracker.chain.velocity
    assert used.c.reset(velocity) == fresh.reset(velocity) == 0
    poses, twists = wave(tracker, START[name], np.random.default_rng(4), 40)
    for k, (pose, twist) in enumerate(zip(poses, twists, strict=True)):
        answers = [c.step(START[name], pose, twist, stamp=k * tracker.dt) for c in (used.c, fresh)]
        assert bytes(answers[0]) == bytes(answers[1])
    assert bytes(used.c.following()) == bytes(fresh.following())


@pytest.mark.nightly
def test_a_solver_that_writes_nothing_brakes(folders: dict[str, Path], built: Built) -> None:
    """What it answered before is not taken for an answer, with the clock and without it."""
    with failing_solvers() as failures:
        tracker = MADE["redundant"]()
    library = giving_up(folders["redundant"], NAME, built, "mirror_tick")
    twins, q = Twins(library, tracker), START["redundant"]
    pose, twist = tracker.chain.pose(q), np.array([0.0, 0.1, 0, 0, 0, 0])
    for k in range(60):
        failures.primary = k % 20 >= 17
        library.give_up(int(failures.primary))
        command = twins.step(q, pose, twist)
        if failures.primary:
            assert "no solver" in command.reason
            assert not command.status.certified
        q = q + command.value * tracker.dt
        pose = pose.copy()
        pose[1, 3] += 0.1 * tracker.dt


def test_inputs_that_are_not_there_are_named(libraries: dict[str, ctypes.CDLL]) -> None:
    q = START["redundant"]
    pose, twist = seven_joints().pose(q), np.zeros(6)
    bad = pose.copy()
    bad[1, 2] = np.nan
    holes = [
        ((None, pose, twist), (0, 0)), ((q, None, twist), (1, 0)), ((q, bad, twist), (1, 6)), ((q, pose, None), (2, 0)),
        ((q, pose, twist, np.array([0.0, np.inf, np.nan])), (3, 1)),
    ]  # fmt: skip
    for inputs, where in holes:
        answer = CMirror(libraries["redundant"]).step(*inputs, stamp=0.0)  # type: ignore[arg-type]
        assert answer.why == "INPUT_INVALID"
        assert (answer.input, answer.element) == where
        assert list(answer.value) == [0.0] * MAX_VALUES


def test_a_tracker_that_was_not_initialised_holds(libraries: dict[str, ctypes.CDLL]) -> None:
    tracker = CMirror(libraries["redundant"], initialise=False)
    answer = tracker.step(START["redundant"], np.eye(4), np.ones(6), stamp=0.0)
    assert (answer.why, answer.status, list(answer.value)) == ("NOT_INITIALISED", 3, [0.0] * MAX_VALUES)
    assert tracker.reset() == 1
    tracker.memory.raw = b"\x5a" * len(tracker.memory)  # what a stack may hold: counts that lead anywhere
    told = tracker.following()
    assert np.isnan([*told.reference, told.manipulability]).all()
    assert (told.lag, told.time_scale, told.braked) == (0.0, 0.0, 0)


def test_a_speed_beyond_its_limit_is_refused(libraries: dict[str, ctypes.CDLL]) -> None:
    for bad in (1.01 * seven_joints().velocity, np.full(7, np.nan)):
        assert CMirror(libraries["redundant"]).reset(bad) == 1
