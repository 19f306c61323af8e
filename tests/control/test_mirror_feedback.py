"""A mirrored hand whose joints are led as exactly as commanded follows as if they were measured."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt import JointFeedback, MirrorTracker, ur5
from tests.control.mirror_campaign import LARGEST

Array = NDArray[np.float64]
START, DT, STILL = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), 2e-3, np.zeros(6)
ROBOT = ur5(acceleration=np.full(6, 10.0))
FIRST = ROBOT.pose(START)


def tracker(feedback: JointFeedback | None) -> MirrorTracker:
    return MirrorTracker(ROBOT, dt=DT, max_manipulability=LARGEST, feedback=feedback, compile=False)


def moved(way: Array, u: float, seconds: float) -> tuple[Array, Array]:
    """Pose (4, 4) and twist (6,) of a minimum-jerk motion by `way` (3,) [m], after the share u of its time."""
    u = min(max(u, 0.0), 1.0)
    pose, twist = FIRST.copy(), np.zeros(6)
    pose[:3, 3] += (10 * u**3 - 15 * u**4 + 6 * u**5) * way
    twist[:3] = (30 * u**2 - 60 * u**3 + 30 * u**4) / seconds * way
    return pose, twist


def test_joints_that_move_as_commanded_get_the_commands_of_measured_positions() -> None:
    """Pushes included: the admittance works where the hand is measured."""
    led, plain, q = tracker(JointFeedback(delay=0.0, servo_hz=math.inf)), tracker(None), START.copy()
    rng = np.random.default_rng(4)
    way, moves = np.array([0.15, -0.1, 0.1]), 0.0
    for k in range(500):
        pose, twist = moved(way, k / 350, 350 * DT)
        force = 20.0 * rng.normal(size=3) if 200 <= k < 400 else None
        command = plain.step(q, pose, twist, force=force)
        np.testing.assert_allclose(led.step(q, pose, twist, force=force).value, command.value, rtol=0, atol=1e-9)
        q, moves = q + DT * command.value, max(moves, float(np.abs(command.value).max()))
    assert moves > 0.3
    assert led.counts == plain.counts
