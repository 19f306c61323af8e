"""A loop on a clock of the test's own: what it sends, when, and why it brakes."""

import gc
import math
import os
import signal
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
from numpy.typing import ArrayLike

from rehab_opt import PoseTracker, ur5
from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop import scheduling
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import Tick, operator_layout, state_layout
from rehab_opt.loop.report import Times
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Measurement, Truth
from tests.loop.clock import Clock
from tests.refusals import refuses

DT = 0.001


class Robot:
    """A device of one joint that stands still; it keeps what it is sent, and when."""

    dt = DT

    def __init__(self, clock: Clock) -> None:
        self.clock, self.sent, self.stopped = clock, list[tuple[float, float]](), 0
        self.lost_at = self.cut_at = self.frozen_at = math.inf
        self.ahead = 0.0

    @property
    def measured(self) -> Measurement:
        if self.clock.now > self.lost_at:
            raise DeviceLostError("robot 10.0.0.7 no longer answers")
        stamp = self.clock.now if self.clock.now < self.frozen_at else self.frozen_at
        return Measurement(stamp + self.ahead, np.zeros(1), np.zeros(1), np.zeros(3))

    @property
    def truth(self) -> Truth:
        return Truth(self.clock.now, np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(3))

    def reset(self, position: ArrayLike) -> Measurement:
        return self.measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        if self.clock.now > self.cut_at:
            raise DeviceLostError("the wire to robot 10.0.0.7 is cut")
        self.sent.append((self.clock.now, float(np.asarray(command)[0])))
        return self.measured

    def stop(self) -> None:
        self.stopped += 1


def one_or_none(tick: Tick) -> Command:
    """Moves with 1 rad/s while it may."""
    status = Status.OK if tick.enabled else Status.HOLDING
    return Command(np.array([float(tick.enabled)]), status, "", 0.0, 0, "", Relaxed.NOTHING, 1.0)


@pytest.fixture
def state() -> Iterator[SharedRing]:
    with SharedRing.create(state_layout(1, operator_layout(1)), depth=2048) as ring:
        yield ring


@pytest.fixture
def operator() -> Iterator[SharedRing]:
    with SharedRing.create(operator_layout(1)) as ring:
        yield ring


def test_ticks_begin_at_their_deadlines_for_ever(clock: Clock) -> None:
    robot = Robot(clock)
    report = Loop(robot, one_or_none).run(seconds=2.0)
    times = np.array([at for at, _ in robot.sent])
    assert report.ticks == len(times) == 2001  # the last one brakes
    np.testing.assert_allclose(times - times[0], DT * np.arange(len(times)), atol=2e-5)
    assert (report.missed, report.late, report.stale) == (0, 0, 0)


def test_a_tick_that_is_late_leaves_out_those_that_are_past(clock: Clock) -> None:
    clock.oversleeps[120] = 0.0054
    robot = Robot(clock)
    report = Loop(robot, one_or_none).run(seconds=0.3)
    times = np.array([at for at, _ in robot.sent])
    assert (report.missed, report.late, report.ticks) == (5, 1, 296)
    assert report.lateness.worst == pytest.approx(0.0054, abs=2e-4)
    late = int(np.argmax(np.diff(times)))
    after = (times[late + 2 :] - times[0]) / DT
    np.testing.assert_allclose(after, np.round(after), atol=0.02)


def test_the_robot_moves_only_while_the_switch_is_held(clock: Clock, state: SharedRing, operator: SharedRing) -> None:
    """Nobody has written; held until 0.1 s later; heartbeats end: the last one counts for less than 150 ms."""
    robot, last = Robot(clock), []

    def beat() -> bool:
        if 100.1 < clock.now < 100.4:
            operator.write(heartbeat=clock.now)
            last.append(clock.now)
        return False

    Loop(robot, one_or_none, state=state, operator=operator).run(seconds=1.0, until=beat)
    moving = [at for at, speed in robot.sent if speed]
    assert moving[0] > 100.1
    assert last[-1] + 0.148 < moving[-1] <= last[-1] + 0.15
    assert all(speed == 0.0 for at, speed in robot.sent if at > last[-1] + 0.15)
    words = list(dict.fromkeys(reason.decode() for reason in state.news().records["reason"]))
    assert words[0] == "nobody operates the robot yet"
    assert words[1] == ""
    assert "last known to be held 0.15 s ago, at most 0.15 s" in words[2]


@pytest.mark.parametrize("heartbeat", [math.nan, math.inf, -math.inf, 1e9])
def test_a_heartbeat_that_is_no_time_of_now_does_not_hold(clock: Clock, operator: SharedRing, heartbeat: float) -> None:
    operator.write(heartbeat=heartbeat)
    robot = Robot(clock)
    Loop(robot, one_or_none, operator=operator).run(seconds=0.05)
    assert not any(speed for _, speed in robot.sent)


def test_a_state_that_grows_old_brakes(clock: Clock, state: SharedRing) -> None:
    robot = Robot(clock)
    robot.frozen_at = 100.2
    report = Loop(robot, one_or_none, state=state, max_age=0.02).run(seconds=0.4)
    assert max(at for at, speed in robot.sent if speed) <= 100.2 + 0.02
    assert report.stale > 100
    assert b"the measured state is 21 ms old, at most 20 ms" in state.news().records["reason"]


@pytest.mark.parametrize(("name", "value", "said"), [("frozen_at", math.nan, b""), ("ahead", 7.0, b"7000 ms ahead")])
def test_a_stamp_that_is_no_time_or_on_another_clock_brakes(
    clock: Clock, state: SharedRing, name: str, value: float, said: bytes
) -> None:
    robot = Robot(clock)
    setattr(robot, name, value)
    Loop(robot, one_or_none, state=state).run(seconds=0.05)
    assert said in state.news().records["reason"][0]
    assert not any(speed for _, speed in robot.sent)


def test_a_command_that_took_too_long_is_not_sent(clock: Clock, state: SharedRing) -> None:
    """Its state has grown old meanwhile: the safe command goes in its place."""
    robot, asked = Robot(clock), []

    def slow(tick: Tick) -> Command:
        asked.append((tick.number, tick.enabled))
        if tick.number == 30 and tick.enabled:
            clock.now += 0.06
        return one_or_none(tick)

    report = Loop(robot, slow, state=state).run(seconds=0.2)
    record = state.news().records[30]
    assert (30, True) in asked
    assert (30, False) in asked
    assert (record["enabled"], record["asked_before"], record["command"][0]) == (0, 2, 0.0)
    assert report.stale == 1
    assert report.missed == 59
    assert sum(speed == 0.0 for _, speed in robot.sent) == 2  # that one and the last


@pytest.mark.parametrize(("cut", "words"), [("lost_at", "no longer answers"), ("cut_at", "the wire to robot")])
def test_a_device_that_is_gone_ends_the_loop_with_a_reason(
    clock: Clock, state: SharedRing, cut: str, words: str
) -> None:
    robot = Robot(clock)
    setattr(robot, cut, 100.1)
    report = Loop(robot, one_or_none, state=state).run(seconds=1.0)
    newest = state.latest()
    assert report.lost
    assert words in report.reason
    assert words in str(report)
    assert newest is not None
    assert newest.record["status"] == b"holding"
    assert words in newest.record["reason"].decode()
    assert robot.stopped == 1


def test_a_watch_brakes_with_its_words(clock: Clock, state: SharedRing) -> None:
    robot = Robot(clock)
    watch: Callable[[], str] = lambda: "the log is full" if clock.now > 100.1 else ""  # noqa: E731
    Loop(robot, one_or_none, state=state, watches=(lambda: "", watch)).run(seconds=0.2)
    assert max(at for at, speed in robot.sent if speed) <= 100.1
    assert b"the log is full" in state.news().records["reason"]


def test_a_device_is_stopped_where_the_controller_fails(clock: Clock) -> None:
    robot = Robot(clock)

    def wrong(tick: Tick) -> Command:
        raise ConfigurationError("q", tick.seen.position, "six of them")

    with pytest.raises(ConfigurationError):
        Loop(robot, wrong).run(seconds=1.0)
    assert robot.stopped == 1


def test_ctrl_c_that_breaks_a_tick_off_brakes(clock: Clock) -> None:
    robot = Robot(clock)

    def interrupted(tick: Tick) -> Command:
        if tick.number == 20:
            raise KeyboardInterrupt
        return one_or_none(tick)

    assert Loop(robot, interrupted).run().reason == "interrupted"
    assert robot.sent[-1][1] == 0.0


def test_a_robot_is_at_rest_when_its_loop_ends(clock: Clock) -> None:
    robot = ur5(velocity=1.0)
    tracker = PoseTracker(robot, dt=DT)
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    plant = IdealJoints(DT)
    plant.reset(q)
    pose, twist = robot.pose(q), np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    pose[2, 3] += 0.1
    speeds = []

    def follow(tick: Tick) -> Command:
        speeds.append(float(np.abs(tick.seen.velocity).max()))
        return tracker.step(tick.seen.position, pose, twist, enable=tick.enabled, stamp=tick.seen.stamp)

    report = Loop(plant, follow).run(seconds=0.1)
    assert max(speeds) > 0.05
    assert not plant.truth.velocity.any()
    assert report.ticks > 100  # those in which it brakes are more


def test_what_was_changed_of_the_process_is_put_back(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError

    assert gc.isenabled()
    before = os.sched_getscheduler(0)
    monkeypatch.setattr(os, "sched_setscheduler", refused)
    with scheduling.in_time(5) as told:
        assert not gc.isenabled()
    assert gc.isenabled()
    assert os.sched_getscheduler(0) == before
    assert told.startswith("SCHED_OTHER: SCHED_FIFO 5 is not permitted")


def test_times_that_are_none_are_refused(clock: Clock) -> None:
    wrong = [("max_age", math.nan), ("max_age", 0.0), ("dead_man", 11.0), ("dead_man", math.nan)]
    refuses(partial(Loop, Robot(clock), one_or_none), *(({name: value}, name) for name, value in wrong))


def test_percentiles_are_those_of_numpy_within_the_bins() -> None:
    drawn = np.random.default_rng(5).lognormal(-9.0, 2.0, size=20_000)
    times = Times()
    for each in drawn:
        times.add(each)
    assert times.worst == drawn.max()
    for percent in (50, 99, 99.9):
        exact = np.percentile(drawn, percent, method="inverted_cdf")
        assert exact <= times.percentile(percent) <= exact * 1.0221


@pytest.mark.parametrize(
    ("number", "ignored", "said"),
    [
        (signal.SIGINT, False, "interrupted"),
        (signal.SIGTERM, False, "ended by SIGTERM"),
        (signal.SIGTERM, True, "ended by SIGTERM"),
    ],
)
def test_ctrl_c_and_sigterm_wait_for_the_end_of_a_tick(
    clock: Clock, number: signal.Signals, ignored: bool, said: str
) -> None:
    """A controller stopped half-way could not brake; a live page's process ignores Ctrl-C."""
    ended, before = [], signal.getsignal(signal.SIGINT)
    left = signal.SIG_IGN if ignored else before

    def decide(tick: Tick) -> Command:
        if tick.number == 20:
            signal.raise_signal(number)
        ended.append(tick.number)
        return one_or_none(tick)

    robot = Robot(clock)
    signal.signal(signal.SIGINT, left)
    try:
        assert Loop(robot, decide).run(seconds=1.0).reason == said
        assert signal.getsignal(signal.SIGINT) is left
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == list(range(22))
    assert [speed for _, speed in robot.sent[20:]] == [1.0, 0.0]


def test_a_command_that_is_no_number_is_not_sent_and_stops_the_device(clock: Clock) -> None:
    def decide(tick: Tick) -> Command:
        command = one_or_none(tick)
        return command._replace(value=np.full_like(command.value, math.nan)) if tick.number == 20 else command

    robot = Robot(clock)
    with pytest.raises(ConfigurationError, match=r"^command = .*finite numbers, in tick 20"):
        Loop(robot, decide).run(seconds=1.0)
    assert len(robot.sent) == 20
    assert robot.stopped == 1


def test_a_second_ctrl_c_ends_a_controller_that_hangs(clock: Clock) -> None:
    def hangs(tick: Tick) -> Command:
        while True:
            signal.raise_signal(signal.SIGINT)

    robot = Robot(clock)
    with pytest.raises(KeyboardInterrupt):
        Loop(robot, hangs).run(seconds=1.0)
    assert robot.stopped == 1
