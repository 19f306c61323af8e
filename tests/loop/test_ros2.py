"""A robot in another process, in the messages of ROS 2."""

import socket
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop import ros2
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.messages import JOINT_STATE
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
    with pytest.raises(DeviceLostError, match="knee"):
        joints_of(bytes(written), ["knee"])


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
