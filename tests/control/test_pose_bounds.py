"""`PoseTracker`: bounds, rest, null space and answers, judged by the bench's own kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from bench.braking import BASE, READY, held, law, limits, place
from rehab_opt import ConfigurationError, PoseTracker, SerialChain, Status

STILL = np.zeros(6)


@pytest.mark.parametrize("seed", range(7100, 7106))
def test_random_limits_and_targets_break_no_bound(seed: int) -> None:
    run = law(seed)
    assert run.worst["acceleration"] <= 1 + 1e-9
    assert run.worst["beyond a joint limit [rad]"] <= 1e-9
    assert run.worst["hand speed"] <= 1.02
    assert run.shakes <= 20


@pytest.mark.parametrize("seed", [7201, 7202, 7203])
def test_limits_of_a_user_are_kept(seed: int) -> None:
    run = limits(seed)
    assert run.worst["below a limit"] <= 1e-9
    assert run.worst["acceleration"] <= 1 + 1e-9
    assert run.shakes <= 20


def test_targets_out_of_reach_leave_the_arm_at_rest() -> None:
    assert next(iter(held((7300, 7301))))[1]["fastest joint at last [rad/s]"] <= 0.02


def test_who_lets_go_brakes_all_joints_alike_within_accelerations() -> None:
    tracker, dt, q = PoseTracker(BASE, dt=0.005, compile=False), 0.005, READY.copy()
    pose = place(BASE, READY + 0.5)
    for _ in range(40):
        last = tracker.step(q, pose, STILL).value
        q = q + dt * last
    for _ in range(200):
        command = tracker.step(q, pose, STILL, enable=False)
        assert np.all(np.abs(command.value - last) <= BASE.acceleration * dt * (1 + 1e-9))
        np.testing.assert_allclose(np.outer(command.value, last), np.outer(last, command.value), atol=1e-12)
        last, q = command.value, q + dt * command.value
    assert command.status is Status.HOLDING


def test_task_weights_count_one_against_the_other() -> None:
    weights = np.array([1.0, 2.0, 0.5, 0.1, 0.1, 0.0])
    some, others = (PoseTracker(BASE, task_weights=k * weights, dt=0.01, compile=False) for k in (1.0, 37.0))
    q, pose = READY.copy(), place(BASE, READY + 0.4)
    for _ in range(50):
        command = some.step(q, pose, STILL)
        np.testing.assert_allclose(others.step(q, pose, STILL).value, command.value, atol=1e-10)
        q = q + 0.01 * command.value


def test_another_solver_gives_the_same_commands() -> None:
    chain = BASE.with_limits(lower=READY - 0.2, upper=READY + 0.2)
    own, other = (PoseTracker(chain, dt=0.01, compile=False, **given) for given in ({}, {"solver": "daqp"}))
    q, pose, seen = READY.copy(), place(chain, READY + 0.5), set()
    for _ in range(80):
        command = own.step(q, pose, STILL)
        seen.add(command.solver)
        assert command.status.certified
        assert command.residual <= 1e-8
        np.testing.assert_allclose(other.step(q, pose, STILL).value, command.value, atol=1e-6)
        q = q + 0.01 * command.value
    assert seen - {"closed form"}


def test_a_seventh_joint_comes_back_after_each_round() -> None:
    chain = SerialChain.from_urdf(
        "problems/robots/franka_panda/panda.urdf", tip="panda_link8", acceleration=4.0
    )  # fmt: skip
    ready, dt = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785]), 0.01
    tracker, first = PoseTracker(chain, dt=dt, gain=20, posture=ready, compile=False), chain.pose(ready)
    q, ends = ready.copy(), []
    for k in range(1200):
        phase = np.pi / 2 * k * dt
        pose, twist = first.copy(), np.zeros(6)
        pose[1:3, 3] += 0.08 * np.array([np.sin(phase), np.cos(phase) - 1])
        twist[1:3] = 0.08 * np.pi / 2 * np.array([np.cos(phase), -np.sin(phase)])
        if k % 400 == 0:
            ends.append(q.copy())
        q = q + dt * tracker.step(q, pose, twist).value
    assert np.abs(ends[2] - ends[1]).max() <= np.deg2rad(0.1)
    assert np.linalg.norm(chain.pose(q)[:3, 3] - pose[:3, 3]) <= 2e-3


@pytest.mark.parametrize(
    ("name", "value"),
    [("gain", 0.0), ("linear_speed", np.nan), ("task_weights", np.zeros(6)), ("posture", np.zeros(5)), ("limits", [3]),
     ("dt", -1.0), ("recovery_speed", 1.0), ("angular_speed", -1.0)],
)  # fmt: skip
def test_arguments_that_cannot_be_used_are_refused(name: str, value: object) -> None:
    with pytest.raises(ConfigurationError, match=name):
        PoseTracker(BASE, **{name: value})  # type: ignore[arg-type]
