"""A Franka behind its real interface, which libfranka speaks: it is led, it stops as it should, and says why."""

import contextlib
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop import franka
from rehab_opt.loop.franka import FrankaDriver, connect_franka
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import Tick
from rehab_opt.loop.scheduling import in_time
from tests.loop.franka_robot import HOST, PYTHON, robot

WATCHDOG = 2.0
"""[s] So long, since this machine may be busy with other tests."""


def test_a_robot_that_is_not_there_is_told() -> None:
    """Before there is one: franka-sim listens at every address of this machine."""
    pytest.importorskip("franky")
    with pytest.raises(DeviceLostError, match=r"Franka at 127\.255\.7\.7 cannot be connected"):
        connect_franka("127.255.7.7")


@pytest.fixture(scope="module")
def server() -> Iterator[None]:
    pytest.importorskip("franky")
    if not PYTHON:
        pytest.skip("REHAB_OPT_FRANKA_SIM names no Python with franka-sim: see tests/loop/franka_robot.py")
    with robot(PYTHON, fifo=1):
        yield


@pytest.mark.usefixtures("server")
def test_a_robot_is_led_and_rests_where_nothing_is_sent() -> None:
    with connect_franka(HOST, watchdog=WATCHDOG, fifo=1) as device:
        start = device.measured.position

        def turn(tick: Tick) -> Command:
            value = np.zeros(7)
            value[3] = 0.2 * tick.enabled
            status = Status.OK if tick.enabled else Status.HOLDING
            return Command(value, status, "", 0.0, 0, "", Relaxed.NOTHING, 1.0)

        loop = Loop(device, turn, max_age=WATCHDOG)
        report = loop.run(seconds=60.0, until=lambda: bool(device.measured.position[3] > start[3] + 0.1))
        assert not report.lost, report.reason
        moved = device.measured.position - start
        assert moved[3] > 0.1
        assert np.abs(np.delete(moved, 3)).max() < 1e-3
        for _ in range(500):
            device.step(0.1 * np.eye(7)[6])
            time.sleep(device.dt)
        until = time.monotonic() + 60.0  # and now nothing is sent any more
        while np.abs(device.measured.velocity).max() > 1e-3 and time.monotonic() < until:
            time.sleep(0.01)
        assert np.abs(device.measured.velocity).max() <= 1e-3


def in_time_at_last(driver: FrankaDriver, steps: Callable[[FrankaDriver], None]) -> None:
    """A machine too busy to answer each cycle is stopped for that, by right."""
    for _ in range(10):
        try:
            return steps(driver)
        except DeviceLostError as refused:
            if str(refused).endswith("control_command_success_rate: 1"):
                raise
            driver._robot.recover_from_errors()
    pytest.skip("this machine is too busy to answer 1000 times a second")


@pytest.mark.usefixtures("server")
def test_steps_are_led_within_the_robot_s_limits_and_one_beyond_them_is_a_reflex_in_words() -> None:
    """The same steps, with the limits that the driver has set, and with franky's own, which an FR3 does not stand."""
    rng = np.random.default_rng(5)

    def steps(driver: FrankaDriver) -> None:
        for k in range(40):
            driver.send([0.0, 0.0, 0.0, 0.3 * (-1) ** k, 0.0, 0.0, 0.2])
            time.sleep(float(rng.uniform(0.003, 0.04)))
            driver.brake()
            time.sleep(0.1)
            driver.read()

    with in_time(1), contextlib.closing(FrankaDriver(HOST, 0.05)) as driver:  # what libfranka starts is as urgent
        in_time_at_last(driver, steps)
        for limit in (driver._robot.joint_jerk_limit, driver._robot.joint_acceleration_limit):
            limit.set(list(limit.max))
        with pytest.raises(DeviceLostError, match=r"reflex.*joint_motion_generator_acceleration_discontinuity"):
            steps(driver)
        driver._robot.recover_from_errors()


def test_without_franky_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(franka, "find_spec", lambda _: None)
    with pytest.raises(ConfigurationError, match=r"rehab_opt\[franka\]"):
        connect_franka(HOST)
