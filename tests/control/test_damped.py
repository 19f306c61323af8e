"""Claims about targets that cannot be had: the arm comes to rest, and no posture near it brings the hand nearer."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rehab_opt import DH, PoseTracker, SerialChain

Array = NDArray[np.float64]
DT = 2e-3
READY = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.0, 0.0])
TURNS = (-np.pi / 2, np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, np.pi / 2, 0.0)
ARM = SerialChain(
    tuple(DH(0.0, turn, length) for turn, length in zip(TURNS, (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126), strict=True)),
    lower=READY - 0.9, upper=READY + 0.9, velocity=np.deg2rad([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0]),
    acceleration=np.full(7, 15.0),
)  # fmt: skip
"""Seven joints, one more than the hand needs."""


@functools.cache
def tracker() -> PoseTracker:
    return PoseTracker(ARM, dt=DT, compile=False)


def beyond_a_limit(number: int) -> tuple[Array, Array]:
    """Where the arm begins (7,), and a pose (4, 4) with one joint beyond its limit: drawn by its number."""
    rng = np.random.default_rng(2)
    for _ in range(number + 1):
        start, beyond = (READY + rng.uniform(-0.3, 0.3, 7) for _ in range(2))
        joint, sign = int(rng.integers(7)), rng.choice([-1.0, 1.0])
        beyond[joint] = (ARM.upper if sign > 0 else ARM.lower)[joint] + sign * rng.uniform(0.1, 0.4)
    return start, ARM.pose(beyond)


def errors(q: Array, target: Array) -> Array:
    """(6,) [m, rad] of the hand at q from its target."""
    here = ARM.pose(q)
    turn = Rotation.from_matrix(target[:3, :3] @ here[:3, :3].T).as_rotvec()
    return np.concatenate([target[:3, 3] - here[:3, 3], turn])


@pytest.mark.parametrize("number", [0, 33])
def test_beside_a_limit_the_arm_comes_to_rest_where_the_hand_is_nearest(number: int) -> None:
    """From 33 on, joints swung to and fro for ever, at 0.6 to 2.3 rad/s: the hand had stopped where it can."""
    q, target = beyond_a_limit(number)
    led, speeds = tracker(), []
    led.reset()
    for _ in range(round(4.0 / DT)):
        command = led.step(q, target, np.zeros(6))
        assert command.status.certified
        q = q + DT * command.value
        speeds.append(float(np.abs(command.value).max()))
    assert max(speeds[-250:]) <= 0.01
    room = ARM.lower - 1e-9, ARM.upper + 1e-9
    nearest = least_squares(errors, np.clip(q, *room), bounds=room, args=(target,), xtol=1e-12, ftol=1e-12)
    assert np.sum(errors(q, target) ** 2) <= 2 * nearest.cost * 1.01


def test_a_target_that_can_be_had_is_come_to_as_before() -> None:
    """The damping is of what cannot be had: the error of one that can halves as often as the gain says."""
    led, rng = tracker(), np.random.default_rng(3)
    led.reset()
    q = READY.copy()
    target = ARM.pose(READY + rng.uniform(-0.02, 0.02, 7))
    sizes = []
    for _ in range(150):
        sizes.append(float(np.linalg.norm(errors(q, target))))
        q = q + DT * led.step(q, target, np.zeros(6)).value
    late = sizes[60:100]
    for before, after in itertools.pairwise(late):
        assert after <= before * np.exp(-led.gain * DT) * 1.02 + 1e-12
