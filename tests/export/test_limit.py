"""A user's own limit appears in the C of the controller that keeps it."""

from pathlib import Path

import numpy as np
import pytest

from rehab_opt import Box, Clearance, ConfigurationError, JointFeedback, KeepOut, MovingCapsule, PoseTracker, ur5
from rehab_opt.export.controllers.pose_tracker import exported_tracker
from rehab_opt.export.export_c import written_files
from rehab_opt.kinematics.room import moving_numbers
from tests.control.clearance_world import Swinging
from tests.control.test_limit import TABLE, elbow, elbow_above, goals, led
from tests.export.calling_c import Built, compiled_once, ran
from tests.judge.ur5_numbers import tool

CLEAR = np.array([0.3, -1.4, 1.9, -1.9, -1.2, 0.4])


def test_c_repeats_a_run_along_a_limit(built: Built, tmp_path: Path) -> None:
    robot = ur5(acceleration=np.full(6, 10.0))
    control = PoseTracker(robot, dt=0.005, backup="qrqp", compile=False, limits=[elbow_above(TABLE)])
    goal = goals(3, 1)[0]
    postures, _, _ = led(control, goal, ticks=400)
    assert elbow(postures).min() < TABLE + 0.02
    pose, still = tool(goal[None])[0], np.zeros(6)
    run = [{"q": q, "pose": pose, "twist": still} for q in postures[::2]]
    exported = exported_tracker(control, run, title="an elbow above a table", of="a run along the limit")
    written_files({tmp_path: exported}, tmp_path, problem="elbow")
    compiled_once(tmp_path, "pose_tracker", built, level="-O0")
    done = ran(built(tmp_path, "repeated", "controller.o", "main.c"), "1e-12")
    assert done.returncode == 0, done.stdout


def test_c_repeats_a_run_among_bodies_that_move(built: Built, tmp_path: Path) -> None:
    robot, dt = ur5(velocity=2.0), 0.01
    floor, box = KeepOut.through([0, 0, 0.1], [0, 0, 1]), Box("box", (0.0, -0.6, 0.3), (0.3, 0.2, 0.4))
    given = Clearance(margin=0.02, planes=[floor], boxes=[box], moving=2)
    control = PoseTracker(robot, dt=dt, backup="qrqp", compile=False, limits=[given])
    swinging, run = Swinging.drawn(np.random.default_rng(2), 1, 0.2), []
    q, place = CLEAR.copy(), robot.pose(CLEAR)[:3, 3] - [0.0, 0.2, 0.0]
    for k in range(300):
        pusher = MovingCapsule(place, place, 0.05, (0.0, 0.1, 0.0), (0.0, 0.1, 0.0))
        told = moving_numbers([*swinging.at(np.array([k * dt]), np.ones(1)), pusher], 2)
        run.append({"q": q, "pose": robot.pose(CLEAR + 0.4), "twist": np.zeros(6), "obstacles": told})
        command = control.step(q, robot.pose(CLEAR + 0.4), np.zeros(6), obstacles=told)
        q, place = q + dt * command.value, place + dt * np.array([0.0, 0.1, 0.0])
    exported = exported_tracker(control, run, title="an arm that gives way", of="a run among bodies")
    written_files({tmp_path: exported}, tmp_path, problem="bodies")
    compiled_once(tmp_path, "pose_tracker", built, level="-O0")
    done = ran(built(tmp_path, "repeated", "controller.o", "main.c"), "1e-12")
    assert done.returncode == 0, done.stdout


def test_a_tracker_that_acts_on_where_joints_are_led_is_refused() -> None:
    control = PoseTracker(ur5(), backup="qrqp", compile=False, feedback=JointFeedback())
    run = [{"q": np.zeros(6), "pose": control.chain.pose(np.zeros(6)), "twist": np.zeros(6)}] * 10
    with pytest.raises(ConfigurationError, match=r"feedback = JointFeedback.*None: C acts on measured positions"):
        exported_tracker(control, run, title="t", of="nothing")
