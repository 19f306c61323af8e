"""The front end of `PoseTracker`: turns, impossible samples, pauses, late and pushed robots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.braking import BASE, READY, place
from rehab_opt import Command, PoseTracker, Relaxed, SerialChain, Status

Array = NDArray[np.float64]
STILL, DT = np.zeros(6), 0.002
GEN3 = Path(__file__).parents[2] / "problems" / "robots" / "kinova_gen3" / "gen3.urdf"


def run(
    ticks: int,
    read: Callable[[int, Array], Array],
    target: Array,
    *,
    moves: Callable[[int, Array], Array] | None = None,
) -> tuple[list[Command], Array]:
    """Commands, and positions (N + 1, 6), of an arm that goes as commanded, or as `moves` says, and is `read`."""
    tracker, q, commands = PoseTracker(BASE, dt=DT, compile=False), [READY.copy()], []
    for k in range(ticks):
        commands.append(tracker.step(read(k, q[-1]), target, STILL))
        value = commands[-1].value
        q.append(q[-1] + DT * (value if moves is None else moves(k, value)))
    return commands, np.array(q)


def within_accelerations(commands: list[Command]) -> bool:
    """Whether every change of velocity is one that the joints can make."""
    values = np.vstack([STILL, [each.value for each in commands]])
    return bool(np.all(np.abs(np.diff(values, axis=0)) <= BASE.acceleration * DT * (1 + 1e-9)))


@pytest.mark.parametrize("lowest", [-np.pi, 0.0])
def test_an_encoder_that_counts_turns_otherwise_changes_nothing(lowest: float) -> None:
    arm = SerialChain.from_urdf(GEN3, tip="end_effector_link", acceleration=2.0)
    start = np.array([0.15 - np.pi, 0.5, 0, 1.5, 0, 1, 0])
    trackers = [PoseTracker(arm, dt=0.005, compile=False) for _ in range(2)]
    q, first = start, arm.pose(start)
    for k in range(400):  # the hand round the base, whose joint is endless, past the place where the encoder wraps
        c, s = np.cos(0.0015 * k), np.sin(0.0015 * k)
        pose = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) @ first
        told = (q - lowest) % (2 * np.pi) + lowest
        wrapped, plain = (each.step(here, pose, STILL) for each, here in zip(trackers, (told, q), strict=True))
        np.testing.assert_allclose(wrapped.value, plain.value, atol=1e-9)
        assert wrapped.status is Status.OK
        q = q + 0.005 * plain.value
    assert q[0] < -np.pi - 0.1


@pytest.mark.parametrize("bad", [np.zeros(6), READY + [0, 0.4, 0, 0, 0, 0], READY + 3.0])
def test_a_sample_that_no_joint_can_have_made_is_named_and_braked_for(bad: Array) -> None:
    commands, _ = run(300, lambda k, q: bad if k in (120, 121, 200) else q, place(BASE, READY + 0.8))
    assert within_accelerations(commands)
    for k, command in enumerate(commands):
        assert command.status.certified is (k not in (120, 121, 200))
    assert "no joint can have come" in commands[120].reason


def test_a_first_sample_of_zeros_is_given_up_for_those_that_follow() -> None:
    commands, q = run(600, lambda k, q: np.zeros(6) if k == 0 else q, place(BASE, READY + 0.2))
    assert within_accelerations(commands)
    assert all(each.status.certified for each in commands)
    np.testing.assert_allclose(place(BASE, q[-1]), place(BASE, READY + 0.2), atol=1e-3)


def test_zeros_for_however_long_lead_an_arm_at_rest_nowhere() -> None:
    commands, q = run(2000, lambda k, q: np.zeros(6) if 700 <= k < 1700 else q, place(BASE, READY + 0.2))
    assert within_accelerations(commands)
    assert np.abs(q[1700:] - q[700]).max() < 1e-3
    assert "no joint can have come" in commands[1699].reason
    assert commands[1701].status.certified


def test_positions_in_degrees_lead_an_arm_nowhere() -> None:
    commands, _ = run(50, lambda k, q: np.rad2deg(q), place(BASE, READY + 0.2))
    assert not any(each.value.any() for each in commands)
    assert {each.reason for each in commands} == {"no joint can have come to these positions"}


def test_one_number_that_is_missing_leaves_the_turns_of_the_others() -> None:
    told = lambda k, q: np.where((np.arange(6) == 5) & (k == 60), np.nan, q + 2 * np.pi)  # noqa: E731
    commands, _ = run(200, told, place(BASE, READY + 0.8))
    assert within_accelerations(commands)
    assert commands[60].status is Status.BRAKING
    assert commands[61].status.certified


@pytest.mark.parametrize("goes_on", [False, True])
def test_after_a_pause_the_arm_starts_from_rest_unless_it_moved_on(goes_on: bool) -> None:
    tracker, q, pose = PoseTracker(BASE, dt=DT, compile=False), READY.copy(), place(BASE, READY + 0.8)
    for k in range(100):
        command = tracker.step(q, pose, STILL, stamp=k * DT)
        q = q + DT * command.value
    fast = command.value
    q = q + (0.1 * fast if goes_on else 0)
    after = tracker.step(q, pose, STILL, stamp=99 * DT + 0.1)
    assert "gap" in after.reason
    assert np.abs(fast).max() > 0.2
    if goes_on:
        assert np.all(np.abs(after.value - fast) <= BASE.acceleration * DT * (1 + 1e-9))
    else:
        assert not after.value.any()
        assert after.relaxed & Relaxed.ACCELERATION
    resumed = tracker.step(q + DT * after.value, pose, STILL, stamp=100 * DT + 0.1)
    assert np.all(np.abs(resumed.value - after.value) <= BASE.acceleration * DT * (1 + 1e-9))


@pytest.mark.parametrize("turns", [0, 1])
def test_behind_a_pause_a_late_arm_passes_no_limit(turns: int) -> None:
    chain = BASE.with_limits(lower=READY - 0.6, upper=READY + 0.6)
    tracker, q, waiting = PoseTracker(chain, dt=DT, compile=False), READY.copy(), [STILL] * 50  # 0.1 s
    pose, now, most, values = place(BASE, READY + [1.2, 0, 0, 0, 0, 0]), 0.0, 0.0, [STILL]
    for k in range(1500):
        now += 0.06 if k == 200 else DT  # meanwhile the drives stop
        values.append(tracker.step(q + 2 * np.pi * turns, pose, STILL, stamp=now).value)
        waiting.append(values[-1])
        q = q + DT * waiting.pop(0)
        most = max(most, float(np.max(q - chain.upper)))
    assert np.abs(values[200]).max() > 0.5
    assert most <= 1e-3
    assert abs(q[0] - chain.upper[0]) <= 2e-3


def test_a_late_and_noisy_arm_stands_still_at_a_joint_limit() -> None:
    rng, waiting = np.random.default_rng(3), [STILL] * 10  # 20 ms
    chain = BASE.with_limits(lower=READY - 0.3, upper=READY + 0.3)
    tracker, q, seen = PoseTracker(chain, dt=DT, compile=False), READY.copy(), []
    pose = place(BASE, READY + [0.5, 0, 0, 0, 0, 0])
    for _ in range(2500):
        waiting.append(tracker.step(q + 1.5e-4 * rng.normal(size=6), pose, STILL).value)
        q = q + DT * waiting.pop(0)
        seen.append(q)
    assert np.ptp(seen[-1000:], axis=0).max() <= 5e-4
    assert abs(seen[-1][0] - chain.upper[0]) <= 1e-3
    assert np.max(seen - chain.upper) <= 1e-3


def test_an_arm_that_is_pushed_aside_is_led_on_from_there() -> None:
    aside = np.array([0.05, -0.05, 0.05, 0.0, 0.05, 0.0])
    push = lambda k, value: value + (aside / DT / 10 if 100 <= k < 110 else 0)  # noqa: E731
    target = place(BASE, READY)
    commands, q = run(1100, lambda _, q: q, target, moves=push)
    assert np.abs(q[110] - READY).max() > 0.03
    assert np.abs(q[610] - READY).max() <= 5e-3
    assert np.linalg.norm(place(BASE, q[-1])[:3, 3] - target[:3, 3]) <= 1e-3
    assert commands[-1].status is Status.OK


def test_a_blocked_joint_is_noticed_and_named() -> None:
    free = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    commands, _ = run(
        400, lambda _, q: q, place(BASE, READY + 0.8), moves=lambda k, value: value * (free if k > 100 else 1)
    )
    named = [k for k, each in enumerate(commands) if "does not follow" in each.reason]
    assert named
    assert (named[0] - 100) * DT <= 0.3
    assert BASE.names[1] in commands[named[0]].reason
    assert within_accelerations(commands)


def test_an_arm_at_half_the_speed_still_arrives() -> None:
    target = place(BASE, READY + 0.3)
    commands, q = run(3500, lambda _, q: q, target, moves=lambda _, value: 0.5 * value)
    assert all(each.status.certified for each in commands)
    np.testing.assert_allclose(place(BASE, q[-1]), target, atol=1e-3)


def test_what_is_no_number_is_named_and_does_not_move_the_arm() -> None:
    commands, _ = run(200, lambda k, q: q * np.nan if 100 <= k < 103 else q, place(BASE, READY + 0.5))
    assert within_accelerations(commands)
    assert "not a valid number" in commands[100].reason
    assert commands[103].status is Status.OK


def test_one_stamp_that_goes_back_makes_no_pause_of_the_next() -> None:
    tracker, q, pose, values = PoseTracker(BASE, dt=DT, compile=False), READY.copy(), place(BASE, READY + 0.8), [STILL]
    for k in range(150):
        values.append(tracker.step(q, pose, STILL, stamp=k * DT - (k == 120)).value)
        q = q + DT * values[-1]
    assert np.all(np.abs(np.diff(values, axis=0)) <= BASE.acceleration * DT * (1 + 1e-9))
