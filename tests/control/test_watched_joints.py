"""Claims about joints that do not follow, found without being told of the robot: which are, and what is none."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from rehab_opt import Command, MirrorTracker, PoseTracker, RedundancyResolver, Status, ardis, ur5
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.control.watched_joints import memory_of_watch, watched_joints
from rehab_opt.kinematics import DriveName

Array = NDArray[np.float64]
START, STILL, ROBOT = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), np.zeros(6), ur5()
TOLERANCE, SHOWS = 0.03, 0.2
"""[rad] and [s]: a fault shows after SHOWS and TOLERANCE over the commanded speed."""
SEATED = np.array([0.0, 0.0, 0.0, -1.0, 0.3, 0.6, 0.0])
NOISE, POLE = 2e-4, 2 * math.pi * 24 / 2.4818


class Joints:
    """Joints behind commands under way and a servo of 24 Hz, or none; encoders with noise; some do not follow."""

    def __init__(self, q: Array, *, dt: float, late: int = 0, servo: bool = False, noise: float = 0.0) -> None:
        self.q, self.dt, self.noise, self.rng = q.copy(), dt, noise, np.random.default_rng(late)
        n = len(q)
        self.v, self.integral, self.pipe = np.zeros(n), np.zeros(n), [np.zeros(n)] * late
        self.after = expm(dt * np.array([[-2 * POLE, POLE**2], [-1.0, 0.0]])) if servo else np.zeros((2, 2))
        self.gain, self.frozen, self.shown = np.ones(n), np.zeros(n, dtype=bool), q.copy()

    def step(self, command: Array) -> Array:
        """(n,) what is measured after a tick of a command."""
        self.pipe.append(command)
        u = self.pipe.pop(0)
        short, integral = self.after @ (self.v - u, self.integral)  # of what the servo lacks
        self.q = self.q + self.gain * (self.dt * u + self.integral - integral)
        self.v, self.integral = u + short, integral
        self.shown = np.where(self.frozen, self.shown, self.q + self.noise * self.rng.normal(size=len(self.q)))
        return self.shown


@cache
def tracker_of(dt: float) -> PoseTracker:
    """One for all claims: to make it takes longer than most of them."""
    return PoseTracker(ROBOT, dt=dt, gain=5.0, compile=False)


@cache
def chair_of(drive: DriveName) -> RedundancyResolver:
    """Likewise."""
    return RedundancyResolver(ardis(), drive=drive, row_sets=[("x", "y", "z")], dt=0.01, compile=False)


def run(joints: Joints, tracker: PoseTracker, way: Callable[[float], Array], seconds: float) -> list[Command]:
    """The commands of a tracker along a way of joints."""
    commands, seen = [], joints.q
    for k in range(round(seconds / joints.dt)):
        commands.append(tracker.step(seen, ROBOT.pose(way(k * joints.dt)), STILL))
        seen = joints.step(commands[-1].value)
    return commands


@pytest.mark.parametrize(("every", "glitches"), [(1, False), (45, True)])
def test_a_fault_shows_behind_slow_encoders_without_stamps_and_beside_one_that_jumps(
    every: int, *, glitches: bool
) -> None:
    joints, tracker = Joints(START, dt=1e-3), tracker_of(1e-3)
    tracker.reset()
    away, seen, told = ROBOT.pose(START + [1.5, 0.3, -0.3, 0.3, 0.3, 0.3]), START, False
    for k in range(1500):
        joints.frozen[0] = k >= 300
        if k == 300:
            led = joints.q[0]
        command = tracker.step(seen, away, STILL)
        told = command.reason.startswith("shoulder_pan does not follow")
        if told:
            break
        assert command.status.certified, command.reason
        shown = joints.step(command.value)
        if (k + 1) % every == 0:
            seen = shown + (glitches and k % 100 >= 100 - every) * np.array([0, 0, 0, 0, 0, 0.3])
    assert told
    speed = float(np.abs(joints.q[0] - led) / (k - 300) / 1e-3)
    assert (k - 300) * 1e-3 <= SHOWS + TOLERANCE / speed + every * 1e-3


def controller_of(name: str) -> tuple[VelocityController | RedundancyResolver, Callable[..., Command], Array]:
    """A controller, its step towards somewhere, and where it starts."""
    if name == "chair":
        chair = chair_of("fixed")
        return chair, lambda q, **told: chair.step(q, np.array([0.0, 0.0, 0.1]), **told), SEATED
    away = ROBOT.pose(START)
    away[:3, 3] += [0.0, 0.05, 0.2]
    known = {"max_manipulability": 0.15}
    law = tracker_of(1e-3) if name == "pose" else MirrorTracker(ROBOT, compile=False, **known)
    return law, lambda q, **told: law.step(q, away, STILL, **told), START


@pytest.mark.parametrize("name", ["pose", "mirror", "chair"])
def test_every_controller_brakes_until_the_enable_input_is_released_or_it_is_reset(name: str) -> None:
    controller, step, start = controller_of(name)
    controller.reset()
    for acknowledged in (False, True):  # and its states with and without stamps
        commands, stamp = [], 0.0
        for _ in range(round(3.0 / controller.dt)):
            stamp += controller.dt
            told = {"stamp": stamp} if acknowledged else {}
            commands.append(step(start, **told))  # every encoder stands still
        first = next(k for k, each in enumerate(commands) if "does not follow" in each.reason)
        fastest = np.abs(np.array([each.value for each in commands[: first + 1]])).max()
        assert first * controller.dt <= SHOWS + TOLERANCE / fastest + 0.1  # which it has to come to first
        assert {each.reason for each in commands[first:]} == {commands[first].reason}
        assert commands[-1].status is Status.HOLDING
        assert not commands[-1].value.any()
        stamp += controller.dt
        step(start, enable=False, stamp=stamp) if acknowledged else controller.reset()
        assert step(start, stamp=stamp + controller.dt).status.certified
        controller.reset()


def test_states_that_are_not_one_motion_are_no_fault() -> None:
    tracker, rng = tracker_of(1e-3), np.random.default_rng(4)
    tracker.reset()
    away = ROBOT.pose(START + 0.3)
    for k in range(500):  # a planner's samples, with stamps
        assert "follow" not in tracker.step(rng.uniform(-2, 2, 6), away, STILL, stamp=1e-3 * k).reason
    tracker.reset()
    joints = Joints(START, dt=1e-3)
    for task in range(4):  # each of which begins elsewhere
        joints.q = START + rng.uniform(-0.5, 0.5, 6)
        for each in run(joints, tracker, lambda _, task=task: START + 0.1 * task, 0.4):
            assert each.status.certified


@pytest.mark.parametrize(("beyond", "one_motion"), [(-1e-4, True), (1e-4, False)])
def test_encoder_that_stands_for_50_ms_may_jump_by_twice_what_the_joint_goes_meanwhile(
    beyond: float, *, one_motion: bool
) -> None:
    dt, speed, spare = 0.01, 0.5, 0.015
    chain = ROBOT.with_limits(velocity=np.full(6, speed))
    watched, record = watched_joints(chain, dt=dt, base=0), memory_of_watch(6)
    memory, command = np.zeros(record.size), np.full(6, 0.1)
    for _ in range(100):
        memory, _ = watched(memory, START, command)
    jump = 2 * speed * (dt + 0.05) + spare + beyond
    memory, _ = watched(memory, START - jump, command)  # against its command: it does not follow
    led = memory.full().ravel()[record.places["led"]]
    assert (led > 0).all() if one_motion else not led.any()


def test_a_chair_whose_place_is_not_measured_is_at_no_fault_and_a_blocked_one_is() -> None:
    chair, ahead = chair_of("mecanum"), np.array([0.1, 0.0, 0.0])
    for measured in (False, True):
        chair.reset()
        seen, reasons = SEATED, []
        for k in range(400):
            command = chair.step(seen, ahead, stamp=0.01 * k)
            moved = 0.01 * command.value
            moved[:3] *= measured and k < 200
            seen = seen + moved
            reasons.append(command.reason)
        assert any("does not follow" in each for each in reasons) == measured
