"""Logs of a loop: what another reader makes of them, and what is left where something breaks."""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import PoseTracker, ur5
from rehab_opt.control.command import Command
from rehab_opt.errors import ProblemFileError
from rehab_opt.loop.log import DEPTH, Log
from rehab_opt.loop.logged import read_log
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import Decide, Tick, operator_layout, state_layout
from rehab_opt.loop.replay import replayed
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.plants.ideal import IdealJoints
from tests.loop.clock import Clock

mcap_reader = pytest.importorskip("mcap.reader")
mcap_ros2 = pytest.importorskip("mcap_ros2.decoder")

DT = 0.004
PATIENCE = 120.0
"""[s] that something may take on a busy machine."""
START = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
ROBOT = ur5(velocity=1.0)
LAYOUT = state_layout(6, operator_layout(6))


@pytest.fixture
def ring() -> Iterator[SharedRing]:
    with SharedRing.create(LAYOUT, depth=DEPTH) as made:
        yield made


def tracking() -> Decide:
    """A tracker that follows the operator's target."""
    tracker = PoseTracker(ROBOT, dt=DT, linear_speed=0.25)
    at_start = ROBOT.pose(START)

    def decide(tick: Tick) -> Command:
        pose = at_start if tick.operator is None else np.ascontiguousarray(tick.operator["target"][0])
        return tracker.step(tick.seen.position, pose, np.zeros(6), enable=tick.enabled, stamp=tick.seen.stamp)

    return decide


def session(ring: SharedRing, path: Path, clock: Clock) -> None:
    """A target is dragged, the switch is let go and held again, a tick takes too long."""
    plant = IdealJoints(DT)
    plant.reset(START)
    decide, rng, target = tracking(), np.random.default_rng(11), ROBOT.pose(START)

    def slow(tick: Tick) -> Command:
        if tick.enabled and not slept and tick.number > 60:
            slept.append(tick.number)
            clock.now += 0.06
        return decide(tick)

    slept: list[int] = []
    clock.now = time.monotonic()  # whose beginning the log's process knows
    with SharedRing.create(operator_layout(6)) as operator, Log(ring, path, names=ROBOT.names) as log:
        ticks = [0]

        def until() -> bool:
            ticks[0] += 1
            target[:3, 3] += 2e-3 * rng.normal(size=3)
            if not 30 < ticks[0] < 45:
                operator.write(heartbeat=clock.now, target=target)
            return ticks[0] > 120

        Loop(plant, slow, state=ring, operator=operator, watches=(log.watch,), max_age=0.05, dead_man=0.03).run(
            until=until
        )
    assert (log.failure, log.lost) == ("", 0)


def test_a_log_says_to_another_reader_what_was_so_and_computes_the_same_again(
    ring: SharedRing, tmp_path: Path, clock: Clock
) -> None:
    path = tmp_path / "trace.mcap"
    session(ring, path, clock)
    written = SharedRing.attach(ring.name, from_start=True).news().records
    topics: dict[str, list[object]] = {}
    with path.open("rb") as file:
        for _, channel, message, decoded in mcap_reader.make_reader(
            file, decoder_factories=[mcap_ros2.DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, decoded))
    decoded_ticks = [each for _, each in topics["/tick"]]
    assert len(decoded_ticks) == len(written)
    for name in LAYOUT.names or ():
        theirs = [getattr(each, name) for each in decoded_ticks]
        if LAYOUT[name].kind == "S":
            assert theirs == [each.decode() for each in written[name]]
        else:
            np.testing.assert_array_equal(np.array(theirs), written[name].reshape(len(written), *np.shape(theirs[0])))
    shown = {tuple(each) for each in written["position"].tolist()}
    at, joints = topics["/joint_states"][0]
    assert joints.name == list(ROBOT.names)
    assert tuple(joints.position) in shown
    assert at == joints.header.stamp.sec * 10**9 + joints.header.stamp.nanosec
    assert abs(at / 1e9 - time.time()) < 3600
    assert {"/tick", "/joint_states", "/force"} == set(topics)

    logged = read_log(path)
    assert logged.whole
    np.testing.assert_array_equal(logged.records, written)
    assert {b"ok", b"braking"} <= set(logged.records["status"])
    assert 2 in logged.records["asked_before"]
    again = replayed(logged.records, tracking())
    assert (again.same, again.first, again.worst) == (len(written), "", 0.0)
    spoilt = logged.records.copy()
    spoilt["position"][70, 2] += 1.0
    other = replayed(spoilt, tracking())
    assert other.same in (70, 71)  # what was measured acts on this command, or through the controller's memory
    assert f"tick {int(spoilt['tick'][other.same])}" in other.first
    lacking = np.delete(logged.records, slice(50, 53))
    assert "3 records before tick" in replayed(lacking, tracking()).first


def fill(ring: SharedRing, count: int, first: int = 1) -> None:
    for number in range(first, first + count):
        ring.write(record=number, clock=time.monotonic(), command=np.full(6, 1.0 / number), status="ok")


def until_written(log: Log, count: int) -> None:
    until = time.monotonic() + PATIENCE
    while log.written < count and not log.failure and time.monotonic() < until:
        time.sleep(0.01)


def test_a_killed_writer_leaves_a_log_and_says_so(ring: SharedRing, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    with Log(ring, path, names=ROBOT.names, problem="mine", files={"mine.toml": b"x = 1\n"}) as log:
        assert os.getpgid(log.process_id) != os.getpgid(0)  # a terminal's Ctrl-C, to all of a group, does not reach it
        fill(ring, 300)
        until_written(log, 300)
        until = time.monotonic() + PATIENCE
        while log.watch() and time.monotonic() < until:  # silent for a while, on a busy machine
            time.sleep(0.01)
        assert log.watch() == ""
        os.kill(log.process_id, signal.SIGKILL)
        os.waitid(os.P_PID, log.process_id, os.WEXITED | os.WNOWAIT)
        assert "its process is gone" in log.watch()
    logged = read_log(path)
    assert not logged.whole
    assert logged.records["record"].tolist() == list(range(1, 301))
    assert (logged.about["problem"], logged.files["mine.toml"]) == ("mine", b"x = 1\n")


def test_a_full_disk_leaves_a_log_and_brakes_the_robot(ring: SharedRing, tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    plant = IdealJoints(DT)
    plant.reset(START)
    with Log(ring, path, names=ROBOT.names) as log:
        room = 60_000
        resource.prlimit(log.process_id, resource.RLIMIT_FSIZE, (room, room))
        rng = np.random.default_rng(2)

        def until() -> bool:  # noise, which does not compress
            ring.record["operator_target"][:] = rng.normal(size=(1, 4, 4))
            return bool(log.failure)

        Loop(plant, tracking(), state=ring, watches=(log.watch,)).run(seconds=PATIENCE, until=until)
        assert "File too large" in log.watch()
    last = ring.latest()
    assert last is not None
    assert last.record["status"] == b"holding"
    logged = read_log(path)
    assert not logged.whole
    assert path.stat().st_size <= room
    assert len(logged.records) > 10
    assert np.all(np.diff(logged.records["record"].astype(int)) >= 0)


def test_what_a_stopped_writer_missed_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    with SharedRing.create(LAYOUT, depth=64) as ring:
        with Log(ring, path, names=ROBOT.names) as log:
            fill(ring, 20)
            until_written(log, 20)
            os.kill(log.process_id, signal.SIGSTOP)
            os.waitid(os.P_PID, log.process_id, os.WSTOPPED | os.WNOWAIT)
            fill(ring, 200, first=21)
            os.kill(log.process_id, signal.SIGCONT)
        assert (log.written, log.lost) == (84, 136)
        assert read_log(path).records["record"].tolist() == [*range(1, 21), *range(157, 221)]


def test_a_killed_loop_leaves_a_whole_log(tmp_path: Path) -> None:
    path = tmp_path / "trace.mcap"
    code = (
        "import os, signal, sys, time\n"
        "from tests.loop.test_log import DEPTH, LAYOUT, ROBOT, Log, SharedRing, fill, until_written\n"
        "ring = SharedRing.create(LAYOUT, depth=DEPTH)\n"
        "log = Log(ring, sys.argv[1], names=ROBOT.names)\n"
        "fill(ring, 500)\n"
        "print(log.process_id, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL
    until = time.monotonic() + PATIENCE
    while not read_log(path).whole and time.monotonic() < until:
        time.sleep(0.05)
    assert read_log(path).records["record"].tolist() == list(range(1, 501))


def test_a_log_that_was_altered_is_refused_and_not_read_in_part(ring: SharedRing, tmp_path: Path, clock: Clock) -> None:
    """One bit, anywhere: only the index behind the data, which is not read, may be another."""
    path = tmp_path / "log.mcap"
    session(ring, path, clock)
    whole, before, refused = path.read_bytes(), read_log(path), 0
    for at in range(0, len(whole), 111):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        try:
            after = read_log(path)
        except ProblemFileError:
            refused += 1
        else:
            assert (after.names, after.about, after.files, after.whole) == (
                before.names, before.about, before.files, before.whole,
            )  # fmt: skip
            np.testing.assert_array_equal(after.records, before.records)
    assert refused > 0.5 * len(whole) / 111
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(40))
    with pytest.raises(ProblemFileError, match=r"log\.mcap"):
        read_log(path)
