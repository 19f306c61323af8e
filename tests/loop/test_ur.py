"""An arm behind UR's real interfaces, which ur_rtde speaks: it is led, and it comes to rest whatever is cut."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import PoseTracker, ur5
from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.errors import ConfigurationError, DeviceLostError, RehabOptError
from rehab_opt.loop import ur
from rehab_opt.loop.delay import measured_delay
from rehab_opt.loop.logged import read_log
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.of_problem import replay_problem, run_in_time
from rehab_opt.loop.records import Tick
from rehab_opt.loop.remote import RemoteDevice
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.loop.ur import connect_ur
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem
from tests.loop.rtde_server import DELAY, ORDERS, START, TRUTH
from tests.refusals import refuses

pytest.importorskip("rtde_control")

HOST = f"127.0.{os.getpid() % 250 + 1}.{os.getpid() // 250 % 250 + 1}"  # ports are fixed: an address for each run


WATCHDOG = 1.5
"""[s] So long, since this machine may be busy with other tests."""
PATIENCE = 60.0
"""[s] that something may take there."""


class Server:
    def __init__(self, truth: SharedRing, orders: SharedRing) -> None:
        self._truth, self._orders = truth, orders

    def __getattr__(self, name: str) -> np.ndarray:
        newest = self._truth.latest()
        assert newest is not None
        value: np.ndarray = newest.record[name]
        return value

    def order(self, *, deaf: bool = False, protective_stop: bool = False, slowed: float = 0.0) -> None:
        self._orders.write(deaf=deaf, protective_stop=protective_stop, slowed=slowed)

    def comes_to_rest(self) -> bool:
        until = time.monotonic() + PATIENCE
        while np.any(self.velocity) and time.monotonic() < until:
            time.sleep(0.01)
        return not np.any(self.velocity)


@pytest.fixture(scope="module")
def running() -> Iterator[Server]:
    with SharedRing.create(TRUTH) as truth, SharedRing.create(ORDERS) as orders:
        command = [sys.executable, "-m", "tests.loop.rtde_server", HOST, truth.name, orders.name]
        with subprocess.Popen(command) as process:
            with contextlib.suppress(PermissionError):  # as urgent as a robot
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(1))
            while truth.latest() is None:
                assert process.poll() is None
                time.sleep(0.01)
            yield Server(truth, orders)
            process.kill()


@pytest.fixture
def server(running: Server) -> Server:
    running.order()
    return running


@pytest.fixture
def robot(server: Server) -> Iterator[RemoteDevice]:
    with connect_ur(HOST, watchdog=WATCHDOG, fifo=1) as made:
        yield made


def moving(tick: Tick) -> Command:
    """The second joint turns at 0.1 rad/s while it may."""
    value = np.array([0.0, 0.1 * tick.enabled, 0.0, 0.0, 0.0, 0.0])
    status = Status.OK if tick.enabled else Status.HOLDING
    return Command(value, status, "", 0.0, 0, "", Relaxed.NOTHING, 1.0)


def test_a_robot_is_led_and_its_delay_measured(robot: RemoteDevice, server: Server) -> None:
    seen = robot.reset(START)
    np.testing.assert_allclose(seen.position, START)
    np.testing.assert_allclose(seen.force, (1.0, 2.0, 3.0))
    with pytest.raises(ConfigurationError, match="where UR at"):
        robot.reset(np.zeros(6))
    delay = delay_once_in_time(robot)
    assert 0.8 * DELAY < delay < DELAY + 0.1
    before = server.position[1]
    loop = Loop(robot, moving, max_age=WATCHDOG)
    report = loop.run(seconds=PATIENCE, until=lambda: bool(server.position[1] > before + 0.02))
    assert not report.lost
    assert server.position[1] > before + 0.02
    assert server.comes_to_rest()
    with pytest.raises(ConfigurationError, match="command"):
        robot.step([0.1, np.nan, 0.0, 0.0, 0.0, 0.0])
    robot.close()
    with pytest.raises(DeviceLostError, match="was closed"):
        _ = robot.measured


def delay_once_in_time(robot: RemoteDevice) -> float:
    """[s] A machine too busy to measure refuses to."""
    for _ in range(5):
        try:
            return measured_delay(robot, joint=1, fifo=1)
        except DeviceLostError as refused:
            if "too late to measure" not in str(refused):
                raise
    return measured_delay(robot, joint=1, fifo=1)


def test_a_problem_file_that_names_the_robot_is_run_on_it_and_again_from_its_log(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mcap")
    monkeypatch.setattr(ur, "connect_ur", partial(connect_ur, watchdog=WATCHDOG))
    text = load_problem("robot/ur5_circle").path.read_text(encoding="utf-8")
    text = text.replace("[0.0, -90.0, 90.0, -90.0, -90.0, 0.0]", str(np.rad2deg(START).tolist()))
    text = text.replace("rate_hz = 1000.0", "rate_hz = 500.0")
    (tmp_path / "mine.toml").write_text(f'{text}\n[plant]\nkind = "ur"\naddress = "{HOST}"\n')
    config, before = load_problem(str(tmp_path / "mine.toml")), server.position
    report, lost = run_in_time(config, seconds=1.5, log=tmp_path / "trace.mcap", fifo=1)
    assert (report.lost, lost) == (False, 0)
    assert server.comes_to_rest()
    assert np.abs(server.position - before).max() > 0.01
    again = replay_problem(read_log(tmp_path / "trace.mcap"))  # which asks no robot
    assert (again.first, again.same) == ("", again.ticks)


@pytest.mark.nightly
def test_a_robot_that_is_elsewhere_or_has_no_address_is_refused(server: Server, tmp_path: Path) -> None:
    text = load_problem("robot/ur5_circle").path.read_text(encoding="utf-8") + '\n[plant]\nkind = "ur"\n'
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(RehabOptError, match="address"):
        run_in_time(load_problem(str(tmp_path / "mine.toml")), seconds=1.0)
    (tmp_path / "mine.toml").write_text(f'{text}address = "{HOST}"\n')
    with pytest.raises(ConfigurationError, match=f"where UR at {HOST} is"):
        run_in_time(load_problem(str(tmp_path / "mine.toml")), seconds=1.0)
    with pytest.raises(ConfigurationError, match=r"plant\.kind"):  # no run as fast as it goes
        run_problem(load_problem(str(tmp_path / "mine.toml")))


@pytest.mark.nightly
def test_a_loop_that_hangs_is_braked_and_may_go_on(robot: RemoteDevice, server: Server) -> None:
    assert sets_in_motion(robot, server)
    assert server.comes_to_rest()
    time.sleep(WATCHDOG)  # its watchdog is told meanwhile
    assert (server.running, server.watchdog) == (1, 0)
    assert sets_in_motion(robot, server)


def sets_in_motion(robot: RemoteDevice, server: Server) -> bool:
    until = time.monotonic() + PATIENCE
    while not np.any(server.velocity) and time.monotonic() < until:
        robot.step([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
        time.sleep(robot.dt)
    return bool(np.any(server.velocity))


def test_a_cut_wire_brakes_on_both_sides_and_is_told(robot: RemoteDevice, server: Server) -> None:
    report = cut_while_moving(robot, lambda: server.order(deaf=True))
    assert "has sent nothing for" in report
    assert server.comes_to_rest()
    assert server.watchdog == 1


def test_a_killed_driver_brakes_the_robot_and_is_told(robot: RemoteDevice, server: Server) -> None:
    assert "the process of its driver is gone" in cut_while_moving(
        robot, lambda: os.kill(robot.process_id, signal.SIGKILL)
    )
    assert server.comes_to_rest()
    assert server.running == 0


@pytest.mark.nightly
def test_a_protective_stop_is_told(robot: RemoteDevice, server: Server) -> None:
    assert "protective stop" in cut_while_moving(robot, lambda: server.order(protective_stop=True))
    assert server.comes_to_rest()


def cut_while_moving(robot: RemoteDevice, cut: Callable[[], None]) -> str:
    ticks: list[int] = []

    def until() -> bool:
        ticks.append(1)
        if len(ticks) == 60:
            cut()
        return False

    report = Loop(robot, moving, max_age=WATCHDOG).run(seconds=PATIENCE, until=until)
    assert report.lost
    return report.reason


def test_a_robot_that_is_not_there_is_told_and_without_ur_rtde_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DeviceLostError, match=r"UR at 127\.255\.7\.7 cannot be connected"):
        connect_ur("127.255.7.7")
    monkeypatch.setattr(ur, "find_spec", lambda _: None)
    with pytest.raises(ConfigurationError, match=r"rehab_opt\[ur\]"):
        connect_ur(HOST)


def test_a_swing_that_is_none_is_refused() -> None:
    plant = IdealJoints(0.005)
    plant.reset(START)
    wrong = [("joint", 6), ("joint", 1.0), ("speed", float("nan")), ("speed", 2.0), ("speed", 0.0)]
    refuses(partial(measured_delay, plant), *(({name: value}, name) for name, value in wrong))


def test_a_slider_at_half_speed_is_read_and_the_arm_arrives_all_the_same(robot: RemoteDevice, server: Server) -> None:
    begin = server.position.copy()
    arm, target = ur5(velocity=1.0), begin + 0.05
    tracker = PoseTracker(arm, dt=robot.dt, linear_speed=0.25, compile=False, max_age=WATCHDOG)
    server.order(slowed=0.5)
    pose = arm.pose(target)
    loop = Loop(robot, lambda tick: tracker.step(tick.seen.position, pose, np.zeros(6), enable=tick.enabled),
                max_age=WATCHDOG)  # fmt: skip

    def there() -> bool:
        return bool(np.abs(arm.pose(server.position) - pose).max() < 1e-3)

    report = loop.run(seconds=PATIENCE, until=there)
    assert report.reason == "on request", report
    assert report.scaling == 0.5
    assert "at 50 % of the commanded speed" in str(report)
    assert server.comes_to_rest()
