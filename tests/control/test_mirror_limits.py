"""Planes and limits of MirrorTracker beside which its frames alone would not keep it."""

import math

import casadi as ca
import numpy as np
import pytest

from rehab_opt import KeepOut, Limit, MirrorTracker, Relaxed, Status, ur5
from tests.control.mirror_campaign import LARGEST

STRETCHED_BESIDE = np.array([0, -1.2, 1.5, -1.8, -1.57, 0])


def test_the_upper_arm_beside_the_line_of_its_frames_stays_out_of_a_plane() -> None:
    """Its frames' origins are 2 mm clear of y = -0.112 when its tube is 78 mm beyond."""
    q = STRETCHED_BESIDE
    beside = KeepOut.through([0, -0.112, 0], [0, 1, 0])
    bare = MirrorTracker(ur5(capsules=()), dt=5e-3, max_manipulability=LARGEST, keep_out=[beside], compile=False)
    assert bare.hand_bounds.min_heights(q, beside) == pytest.approx(0.112 - 0.10915, abs=1e-4)
    arm = MirrorTracker(ur5(), dt=5e-3, max_manipulability=LARGEST, keep_out=[beside], compile=False)
    assert arm.hand_bounds.min_heights(q, beside) == pytest.approx(0.112 - 0.149 - 0.073, abs=1e-9)
    for enable in (True, False):  # beyond it, which is said
        assert arm.step(q, ur5().pose(q), np.zeros(6), enable=enable).relaxed & Relaxed.POSITION
    # A plane that the whole arm is clear of by 5 mm: turning the base towards it stops there.
    plane = KeepOut.through([0, -0.227, 0], [0, 1, 0])
    robot = MirrorTracker(
        ur5(), dt=5e-3, max_manipulability=LARGEST, max_deviation=1.0, keep_out=[plane], compile=False
    )
    lowest = math.inf
    for k in range(250):
        pose = ur5().pose(q + [0.3 * min(k / 100, 1), 0, 0, 0, 0, 0])
        q = q + 5e-3 * robot.step(q, pose, np.zeros(6)).value
        lowest = min(lowest, robot.hand_bounds.min_heights(q, plane).item())
    assert -1e-9 <= lowest < 3e-3


def test_a_hand_whose_step_is_shortened_to_nothing_is_blocked_until_the_way_is_free() -> None:
    """Four distances of one limit at zero: three make rows, and the step is shortened before the fourth."""
    robot, q = ur5(velocity=1.0), STRETCHED_BESIDE
    pose, down = robot.pose(q), np.array([0.0, 0.0, -0.04, 0.0, 0.0, 0.0])
    table = float(pose[2, 3])
    corner = Limit(lambda arm, x: ca.vertcat(x[5], -x[5], x[5], arm.pose_expression(x)[2, 3] - table))
    tracker = MirrorTracker(robot, dt=5e-3, floor=0.05, limits=[corner], max_manipulability=LARGEST, compile=False)
    for twist, status, least, largest in ((down, Status.BLOCKED, 0.0, 0.0), (-down, Status.OK, 0.01, 1.0)):
        for _ in range(100 if status is Status.BLOCKED else 300):
            pose = pose.copy()
            pose[:3, 3] += twist[:3] * tracker.dt
            command = tracker.step(q, pose, twist)
            q = q + tracker.dt * command.value
        assert command.status is status, command.reason
        assert least <= np.abs(command.value).max() <= largest
        assert (command.scale == 0) == (status is Status.BLOCKED)
