"""A controller belongs to one thread: a second one, a copy and a pickle are refused, and it can be handed over."""

from __future__ import annotations

import copy
import pickle
import threading
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt import ArmIK, RehabOptError, SharingError, human_arm
from rehab_opt.control.ik_search import IKSearch
from rehab_opt.symbolic import BufferedFunction
from tests.control.every_controller import CASES, HAND, POSE, READY, as_new, assistance, made
from tests.refusals import refuses


class Other:
    """Another thread, which lives until it is told to end, and does one thing after the other."""

    def __init__(self) -> None:
        self._tasks: list[Callable[[], Any]] = []
        self._wake, self._done = threading.Semaphore(0), threading.Semaphore(0)
        self._result: tuple[Any, BaseException | None] = (None, None)
        self._thread = threading.Thread(target=self._run, name="second", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            self._wake.acquire()
            if not self._tasks:
                return
            try:
                self._result = self._tasks.pop()(), None
            except RehabOptError as error:
                self._result = None, error
            self._done.release()

    def does(self, task: Callable[[], Any]) -> Any:
        self._tasks.append(task)
        self._wake.release()
        assert self._done.acquire(timeout=60)
        result, error = self._result
        if error is not None:
            raise error
        return result

    def end(self) -> None:
        self._wake.release()
        self._thread.join()


@pytest.fixture
def other() -> Any:
    thread = Other()
    yield thread
    thread.end()


def test_no_buffers_are_copied() -> None:
    x = ca.SX.sym("x")
    buffered = BufferedFunction(ca.Function("f", [x], [x]))
    for again in (copy.copy, copy.deepcopy, pickle.dumps):
        refuses(again, ((buffered,), "BufferedFunction"), error=SharingError)


every = pytest.mark.parametrize("name", CASES)


@every
def test_a_second_thread_is_refused_and_changes_nothing(name: str, other: Other) -> None:
    controller, tick = as_new(name)
    _, undisturbed = as_new(name, 1)
    assert_same(tick(), undisturbed())
    with pytest.raises(SharingError, match=r"belongs to thread 'MainThread'.*not to 'second'.*make one per thread"):
        other.does(tick)
    with pytest.raises(SharingError):
        other.does(lambda: CASES[name].reset(controller))
    for _ in range(3):
        assert_same(tick(), undisturbed())
    for again in (copy.copy, copy.deepcopy, pickle.dumps):
        refuses(again, ((controller,), "make another one with the same arguments"), error=SharingError)
    CASES[name].reset(controller)  # by its owner: it is handed over
    other.does(tick)
    with pytest.raises(SharingError):
        CASES[name].reset(controller)
    other.end()
    tick()  # what a thread that has ended owned is free
    CASES[name].reset(controller)


@pytest.mark.parametrize(
    "change",
    [
        lambda a: a.set_field(a.field),
        lambda a: a.shift(0.0, 0.0),
        lambda a: a.give_energy(0.1),
    ],
)
def test_another_thread_changes_no_setting_of_assistance(change: Callable[[Any], Any], other: Other) -> None:
    helper = assistance()
    other.does(lambda: change(helper))  # before the first tick it may
    helper.step(HAND)
    with pytest.raises(SharingError):
        other.does(lambda: change(helper))
    helper.step(HAND)


def test_a_plan_belongs_to_its_thread_too(other: Other) -> None:
    tracker, tick = as_new("mirror_tracker")
    tick()
    with pytest.raises(SharingError):
        other.does(lambda: tracker.plan(POSE[None], np.zeros((1, 6)), READY))
    tracker.plan(POSE[None], np.zeros((1, 6)), READY)
    with pytest.raises(SharingError):
        other.does(tick)


def test_of_two_threads_that_begin_at_once_one_is_refused() -> None:
    for _ in range(20):
        _, tick = made("joystick")
        begin, hold, refused = threading.Barrier(2), threading.Barrier(2), []

        def run(tick=tick, begin=begin, hold=hold, refused=refused) -> None:  # type: ignore[no-untyped-def]
            begin.wait()
            try:
                tick()
            except SharingError:
                refused.append(1)
            hold.wait()  # both live until both have tried

        threads = [threading.Thread(target=run) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert refused == [1]


class TestArmIK:
    """It remembers nothing, so whoever comes when it is idle may use it."""

    def test_a_second_thread_meanwhile_is_refused(self, other: Other, monkeypatch: pytest.MonkeyPatch) -> None:
        solver, place = ArmIK(human_arm(), compile=False), [-0.15, 0.45, -0.24]
        search, met = IKSearch.posture, list[Exception]()

        def interrupted(*given: Any, **more: Any) -> Any:
            for ask in (lambda: solver.solve(place), lambda: solver.follow([place])):
                try:
                    other.does(ask)
                except SharingError as error:
                    met.append(error)
            return search(*given, **more)

        monkeypatch.setattr(IKSearch, "posture", interrupted)
        assert solver.solve(place).status.certified
        assert len(met) == 2

    def test_a_copy_is_a_solver_of_its_own(self, other: Other, monkeypatch: pytest.MonkeyPatch) -> None:
        """Another thread asks it for another place in the middle of a search, which does not notice."""
        solver, place = ArmIK(human_arm(), compile=False), [-0.15, 0.45, -0.24]
        twin = pickle.loads(pickle.dumps(copy.copy(solver)))
        alone = solver.solve(place).q
        assert_same(twin.solve(place).q, alone)
        search = IKSearch.posture

        def interrupted(*given: Any, **more: Any) -> Any:
            monkeypatch.undo()
            assert other.does(lambda: twin.solve([-0.2, 0.4, -0.3])).status.certified
            return search(*given, **more)

        monkeypatch.setattr(IKSearch, "posture", interrupted)
        assert_same(solver.solve(place).q, alone)
        assert IKSearch.posture is search  # it was interrupted


def assert_same(one: Any, other: Any) -> None:
    """The same numbers in a command, or whatever it is."""
    if isinstance(one, tuple):
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    elif isinstance(one, np.ndarray | float):
        np.testing.assert_array_equal(one, other)
    else:
        assert one == other
