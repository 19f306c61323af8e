"""A robot in another process, in the messages of ROS 2."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop import ros2
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.messages import JOINT_STATE, joint_state
from rehab_opt.loop.of_problem import connected
from rehab_opt.loop.records import Tick
from rehab_opt.loop.ros2 import connect_ros2, joints_of
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.session.plant import JointPlant, device_of

pytest.importorskip("zenoh")
dynamic = pytest.importorskip("mcap_ros2._dynamic")

WATCHDOG = 2.0
"""[s] So long, since this machine may be busy with other tests."""
PATIENCE = 120.0
"""[s] that something may take there."""


@pytest.mark.parametrize("seed", range(6))
def test_joint_states_are_read_as_another_library_writes_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = [
        "".join(rng.choice(list("abcö"), size=int(rng.integers(1, 9)))) + str(i) for i in range(int(rng.integers(1, 9)))
    ]
    position, velocity = rng.normal(size=(2, len(names)))
    velocity = velocity if seed % 2 else np.zeros(0)
    message = {
        "header": {"stamp": {"sec": 5, "nanosec": 6}, "frame_id": "f" * (seed % 5)}, "name": names,
        "position": position.tolist(), "velocity": velocity.tolist(), "effort": [1.0],
    }  # fmt: skip
    written = dynamic.serialize_dynamic(JOINT_STATE.name, JOINT_STATE.definition)[JOINT_STATE.name](message)
    order = rng.permutation(len(names))
    found = joints_of(bytes(written), [names[i] for i in order])
    np.testing.assert_array_equal(found[0], position[order])
    np.testing.assert_array_equal(found[1], velocity[order] if velocity.size else np.zeros(len(names)))
    cut = int(rng.integers(len(written) - 20))
    with pytest.raises(DeviceLostError):
        joints_of(bytes(written)[:cut], names)
    assert np.isnan(joints_of(bytes(written), ["knee"])).all()


def a_driver(monkeypatch: pytest.MonkeyPatch, names: list[str]) -> tuple[ros2.Ros2Driver, Callable[..., None]]:
    """A driver without a network, and what brings it a message on a topic."""
    subscribers: dict[str, Callable[[Any], None]] = {}
    session = SimpleNamespace(declare_subscriber=subscribers.__setitem__, declare_publisher=lambda _: None)
    zenoh = SimpleNamespace(
        Config=lambda: SimpleNamespace(insert_json5=lambda *_: None), open=lambda _: session, ZError=OSError
    )
    monkeypatch.setattr(ros2, "import_module", lambda _: zenoh)
    driver = ros2.Ros2Driver(names, "", "states", "", "scaling")

    def come(message: bytes, topic: str = "states") -> None:
        subscribers[topic](SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: message)))

    return driver, come


@pytest.mark.parametrize("seed", range(8))
def test_joints_that_come_in_several_messages_are_one_state(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Two joints at once, in any order, with wheels and a gripper between; each is read once, with its newest value."""
    rng = np.random.default_rng(seed)
    names = [f"joint_{i}" for i in range(int(rng.integers(2, 8)))]
    driver, come = a_driver(monkeypatch, names)
    position, velocity = rng.normal(size=(2, len(names)))
    others = [(["left_wheel", "right_wheel"], [9.0, 8.0]), (["finger"], [0.04]), ([], [])]
    assert driver.read() is None
    for tick in range(1, 20):
        parts = np.split(rng.permutation(len(names)), range(2, len(names), 2))
        reads = rng.random(len(parts)) < 0.5
        for number, part in enumerate(parts):
            told, at = others[int(rng.integers(3))]
            come(joint_state(tick, told, at, at))
            if seed % 2:  # what comes twice between two looks counts as it came last
                come(joint_state(tick, [names[i] for i in part], position[part] - 1.0))
            come(joint_state(tick, [names[i] for i in part], position[part] + tick, velocity[part] * tick))
            if number < len(parts) - 1 and reads[number]:
                assert driver.read() is None
        reading = driver.read()
        assert reading is not None
        np.testing.assert_array_equal(reading.position, position + tick)
        np.testing.assert_array_equal(reading.velocity, velocity * tick)
        assert driver.read() is None


def test_a_joint_that_never_comes_is_named_and_one_of_two_places_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    driver, come = a_driver(monkeypatch, ["shoulder", "elbow"])
    come(joint_state(0, ["shoulder", "finger"], [0.1, 0.2]))
    assert driver.read() is None
    monkeypatch.setattr(ros2, "UNHEARD", 0.0)
    come(joint_state(1, ["shoulder", "elbow"], [], [1.0, 1.0]))
    with pytest.raises(DeviceLostError, match="without a position of elbow"):
        driver.read()
    assert joints_of(joint_state(2, ["a", "a", "b"], [1.0, 1.0, 2.0]), ["b", "a"])[0].tolist() == [2.0, 1.0]
    assert joints_of(joint_state(2, ["a", "b"], [1.0, 2.0], [np.nan, 3.0]), ["a", "b"])[1].tolist() == [0.0, 3.0]
    for told, at in ((["a", "a"], [1.0, 1.1]), (["a"], [1.0, 2.0]), ([], [1.0])):
        with pytest.raises(DeviceLostError, match="cannot be read"):
            joints_of(joint_state(3, told, at), ["a"])


def test_speed_scaling_is_read_in_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    float64 = dynamic.serialize_dynamic("std_msgs/msg/Float64", "float64 data")["std_msgs/msg/Float64"]
    driver, come = a_driver(monkeypatch, ["elbow"])
    told: list[float] = []
    for percent in (None, 100.0, 37.5, 0.0):
        if percent is not None:
            come(bytes(float64({"data": percent})), "scaling")
        come(joint_state(1, ["elbow"], [0.1]))
        reading = driver.read()
        assert reading is not None
        told.append(reading.scaling)
    assert told == [1.0, 1.0, 0.375, 0.0]
    for wrong in (
        bytes(float64({"data": np.nan})),
        bytes(float64({"data": -1.0})),
        bytes(float64({"data": 1.0}))[:9],
        b"",
    ):
        come(wrong, "scaling")
        come(joint_state(2, ["elbow"], [0.1]))
        with pytest.raises(DeviceLostError, match="a speed scaling"):
            driver.read()


def test_a_robot_that_a_problem_file_names_is_led_and_its_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs in another process, and its joints are called as the problem's own."""
    from tests.loop.ros2_robot import NAMES, START, TRUTH  # noqa: PLC0415  (needs zenoh)

    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    monkeypatch.setattr(ros2, "connect_ros2", partial(connect_ros2, watchdog=WATCHDOG))
    table = JointPlant(kind="ros2", address=address)
    problem: Any = SimpleNamespace(device=device_of(table), names=NAMES, encoders=3, dt=0.005)

    def move(tick: Tick) -> Command:
        status = Status.OK if tick.enabled else Status.HOLDING
        value = np.array([0.1, -0.2, 0.3]) * tick.enabled
        return Command(value, status, "", 0.0, 0, "", Relaxed.NOTHING, 1.0)

    with SharedRing.create(TRUTH) as truth:
        command = [sys.executable, "-m", "tests.loop.ros2_robot", address.rpartition(":")[2], truth.name]
        with subprocess.Popen(command) as process:
            while truth.latest() is None:
                assert process.poll() is None
                time.sleep(0.01)
            with connected(problem) as robot:
                np.testing.assert_allclose(robot.reset(START).position, START)
                went: list[np.ndarray] = []

                def until() -> bool:
                    newest = truth.latest()
                    assert newest is not None
                    if newest.record["velocity"].any():
                        went.append(newest.record["velocity"])
                    return len(went) > 20 and robot.measured.position[0] > START[0]

                assert not Loop(robot, move, max_age=WATCHDOG).run(seconds=PATIENCE, until=until).lost
                np.testing.assert_array_equal(went[0], [0.1, -0.2, 0.3])
                moved = robot.measured.position - START
                np.testing.assert_allclose(moved / moved[0], [1.0, -2.0, 3.0], rtol=1e-6)
                assert moved[0] > 0.0
                process.kill()
                report = Loop(robot, move, max_age=WATCHDOG).run(seconds=PATIENCE)
                assert report.lost
                assert "has sent nothing for" in report.reason


def test_what_cannot_be_connected_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DeviceLostError, match="cannot be connected"):
        connect_ros2(["elbow"], rate_hz=100.0, locator="tcp/127.0.0.1:1")
    with pytest.raises(ConfigurationError, match="names"):
        connect_ros2(["elbow", "elbow"], rate_hz=100.0)
    monkeypatch.setattr(ros2, "find_spec", lambda _: None)
    with pytest.raises(ConfigurationError, match=r"rehab_opt\[ros2\]"):
        connect_ros2(["elbow"], rate_hz=100.0)
