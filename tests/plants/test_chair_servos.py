"""Chair and arm on late servos and noisy encoders: a joint limit, approached at 1/T, holds; led, nothing swings."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import RedundancyResolver, Status, ardis
from rehab_opt.control.hand_task import ROWS
from rehab_opt.kinematics import DriveName

Array = NDArray[np.float64]

STEP = 0.001
"""[s] of the plant."""
POLE = 2 * math.pi * 24.0 / 2.4818
"""[1/s] of a proportional-integral velocity servo of 24 Hz with both poles at one place."""
WHEEL_LAG = 0.08
"""[s]"""


class LateChair:
    """Arm joints with velocity servos, a chassis that lags and goes where it heads; commands and encoders are late."""

    def __init__(self, q: Array, *, delay: float, noise: float, seed: int) -> None:
        late = round(delay / STEP)
        self.q, self.u, self.behind = q.copy(), np.zeros(7), np.zeros(4)
        self.sent: deque[Array] = deque([np.zeros(7)] * (late - late // 2))
        self.told: deque[Array] = deque([q.copy()] * (late // 2 + 1), maxlen=late // 2 + 1)
        self.noise, self.rng = noise, np.random.default_rng(seed)

    def measured(self) -> Array:
        return np.asarray(self.told[0] + self.noise * self.rng.standard_normal(7))

    def hold(self, u: Array, seconds: float) -> list[Array]:
        """The ways of all steps under a command (7,), the chair's share in its own frame."""
        way = []
        for _ in range(round(seconds / STEP)):
            self.sent.append(u)
            command = self.sent.popleft()
            short = command[3:] - self.u[3:]
            self.u[3:] += STEP * (2 * POLE * short + POLE * POLE * self.behind)
            self.behind += STEP * short
            self.u[:3] += (STEP / WHEEL_LAG) * (command[:3] - self.u[:3])
            c, s = math.cos(self.q[2] + STEP * self.u[2] / 2), math.sin(self.q[2] + STEP * self.u[2] / 2)
            forward, left = self.u[:2]
            self.q = self.q + STEP * np.concatenate([[c * forward - s * left, s * forward + c * left], self.u[2:]])
            self.told.append(self.q)
            way.append(self.q)
        return way


@pytest.mark.parametrize(("drive", "delay"), [("mecanum", 0.0), ("differential", 0.008)])
def test_a_joint_limit_is_held_on_late_servos_and_noisy_encoders_without_a_limit_cycle(
    drive: DriveName, delay: float
) -> None:
    dt, rows = 0.01, ROWS[:3]
    resolver = RedundancyResolver(ardis(), drive=drive, dt=dt, row_sets=[rows], compile=False)
    chain = resolver.robot.chain
    plant = LateChair(np.array([0.0, 0.0, 1.0, -2.7, 0.0, 1.25, 0.05]), delay=delay, noise=2e-4, seed=7)
    resolver.reset(heading=1.0)
    ways: list[Array] = []
    for _ in range(1400):  # a hand that creeps to its limit insists for some seconds (`hand_task.CREEPS`)
        resolver.step(plant.measured(), np.array([0.0, 0.0, -0.2]), rows)
        ways += plant.hold(resolver.chassis_velocity, dt)
    way = np.array(ways)
    beyond = np.maximum(way - chain.upper, chain.lower - way)[:, 3:]
    assert beyond.max() <= 5e-4
    held = way[-3000:]
    assert np.ptp(held[:, 3:], axis=0).max() <= 3e-4
    assert np.sort(beyond[-3000:].max(axis=0))[-1] > -3e-4  # one of them is at its limit
    hand = np.array([chain.pose(q)[:3, 3] for q in held[::10]])
    assert np.sqrt((np.diff(hand, axis=0) ** 2).sum(axis=1).mean()) / (10 * STEP) <= 2e-3


SEATED = np.array([0.0, 0.0, 1.0, -2.7, 0.0, 1.25, 0.05])


def test_joints_come_to_rest_at_a_limit() -> None:
    """On the simulated wheelchair: masses, friction, wheels behind."""
    pytest.importorskip("mujoco")
    from rehab_opt.plants.channel import Channel  # noqa: PLC0415  (needs MuJoCo)
    from rehab_opt.plants.wheelchair import Wheelchair  # noqa: PLC0415

    dt, rows, swings = 0.005, ROWS[:3], []
    for delay in (0.0, 0.008):
        resolver = RedundancyResolver(ardis(), dt=dt, row_sets=[rows], compile=False)
        chain, wheels = resolver.robot.chain, resolver.robot.drive("mecanum")
        way = Channel(command_delay=delay / 2, measurement_delay=delay / 2, position_noise=1e-4)
        plant = Wheelchair(resolver.robot, wheels, dt=dt, channel=way, seed=7)
        seen, true = plant.reset(SEATED), []
        resolver.reset(heading=1.0)
        for _ in range(round(7.0 / dt)):
            command = resolver.step(seen.position, np.array([0.0, 0.0, -0.2]), rows)
            seen = plant.step(np.append(command.wheels, command.value[3:]))
            true.append(plant.truth.position)
        beyond = np.maximum(true - chain.upper, chain.lower - true)[:, 3:]
        assert beyond.max() <= 5e-4
        assert beyond[-1].max() > -3e-4  # one of them is at its limit
        swings.append(np.ptp(true[-round(1.0 / dt) :], axis=0)[3:].max())
    assert max(swings) <= 3e-4


def test_a_delay_of_a_tenth_of_a_second_is_no_fault_of_an_arm_that_turns_back() -> None:
    dt = 0.02
    resolver = RedundancyResolver(ardis(), drive="fixed", dt=dt, row_sets=[ROWS[:3]], compile=False)
    plant = LateChair(np.array([0.0, 0.0, 0.0, -0.9, 0.0, -0.1, 0.0]), delay=0.1, noise=0.0, seed=0)
    for k in range(60):
        command = resolver.step(plant.measured(), np.array([0.0, 0.0, 0.25 if k // 20 % 2 == 0 else -0.25]))
        plant.hold(resolver.chassis_velocity, dt)
        assert command.status.certified, (k, command.reason)


@pytest.mark.parametrize("joint", [0, 3])
def test_a_blocked_joint_of_a_led_chair_is_named_and_one_of_its_base(joint: int) -> None:
    resolver = RedundancyResolver(ardis(), dt=0.01, row_sets=[ROWS[:3]], compile=False)
    q, ahead = np.array([0.0, 0.0, 0.0, -1.0, 0.3, 0.6, 0.0]), np.array([0.2, 0.0, -0.05])
    reasons = []
    for k in range(300):
        command = resolver.step(q, ahead)
        moved = 0.01 * command.value
        moved[joint] *= k < 50
        q = q + moved
        reasons.append(command.reason)
    assert reasons[49] == ""
    assert command.status is Status.HOLDING
    assert command.reason.startswith(f"{resolver.robot.chain.names[joint]} does not follow")
