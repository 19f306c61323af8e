"""What is said of a motion of which the bounds leave nothing, and where a redundant arm moves by itself."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from bench.braking import BASE, READY, place
from rehab_opt import Limit, PoseTracker, SerialChain, Status

STILL = np.zeros(6)


def rested(tracker: PoseTracker, pose: np.ndarray, start: np.ndarray = READY) -> tuple[str, np.ndarray]:
    """The reason when the arm has come to rest, and where."""
    q, command = start.copy(), None
    for _ in range(1500):
        command = tracker.step(q, pose, STILL)
        q = q + tracker.dt * command.value
    assert command is not None
    assert np.abs(command.value).max() < 1e-3
    assert command.status is Status.BLOCKED
    return command.reason, q


def test_a_joint_at_its_limit_is_named() -> None:
    limits = np.full(6, np.inf)
    limits[0] = 0.2
    chain = BASE.with_limits(upper=np.minimum(READY + limits, BASE.upper))
    pose = place(BASE, READY + np.r_[0.6, np.zeros(5)])
    said, q = rested(PoseTracker(chain, dt=0.01, task_weights=[1, 1, 0, 0, 0, 0], compile=False), pose)
    assert any(f"{chain.names[i]} at its limit blocks" in said for i in np.flatnonzero(chain.upper - q < 1e-3)), said


def test_a_pose_out_of_reach_is_named() -> None:
    pose = place(BASE, READY)
    pose[:3, 3] *= 4
    assert rested(PoseTracker(BASE, dt=0.01, compile=False), pose)[0] == "the pose is out of reach"


def test_a_limit_of_a_user_is_named() -> None:
    wall = Limit(place_x)
    pose = place(BASE, READY)
    pose[0, 3] -= 0.2
    tracker = PoseTracker(BASE, dt=0.01, limits=[wall], compile=False)
    assert rested(tracker, pose)[0] == "a limit of the posture blocks the motion"


def place_x(chain: SerialChain, q: ca.SX) -> ca.SX:
    """[m] before a wall 5 cm behind the tool."""
    return chain.pose_expression(q)[0, 3] - (place(BASE, READY)[0, 3] - 0.05)


@pytest.mark.parametrize("posture", [None, "own"])
def test_a_redundant_arm_moves_to_its_posture_no_faster_than_it_recovers(posture: str | None) -> None:
    chain = SerialChain.from_urdf("problems/robots/franka_panda/panda.urdf", tip="panda_link8", acceleration=4.0)
    ready, dt = np.array([0.3, -0.785, 0.4, -2.2, 0.3, 1.571, 0.785]), 0.01
    own = ready + 0.2 if posture else None
    tracker, q, pose = PoseTracker(chain, dt=dt, posture=own, compile=False), ready.copy(), chain.pose(ready)
    middle = (chain.lower + chain.upper) / 2 if own is None else own
    for _ in range(1500):
        value = tracker.step(q, pose, STILL).value
        assert np.all(np.abs(value) <= 0.1 * chain.velocity * 1.05)
        q = q + dt * value
    assert np.linalg.norm(chain.pose(q)[:3, 3] - pose[:3, 3]) < 1e-4
    assert np.linalg.norm(q - middle) < np.linalg.norm(ready - middle)
    assert np.abs(value).max() < 1e-3
