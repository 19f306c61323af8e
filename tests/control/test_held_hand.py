"""Claims about a led hand on a simulated arm: what friction holds back is led after, what holds it is noticed."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rehab_opt import Command, JointFeedback, PoseTracker, Relaxed, Status, ur5
from rehab_opt.control.joint_feedback import COUPLED

Array = NDArray[np.float64]
START, DT, SPEED, STILL = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), 1e-3, 0.25, np.zeros(6)
ROBOT = ur5(acceleration=np.full(6, 10.0))
LED = JointFeedback(delay=0.005)


def tracker(feedback: JointFeedback) -> PoseTracker:
    return PoseTracker(ROBOT, feedback=feedback, dt=DT, compile=False)


def at_a_wall(feedback: JointFeedback, gone: float, seconds: float):  # type: ignore[no-untyped-def]
    """Time of touch, commands, true forces [N] and hand speeds [m/s] of a hand led into a wall that is taken away."""
    pytest.importorskip("mujoco")
    from rehab_opt.plants.arm_model import ur5_model  # noqa: PLC0415
    from rehab_opt.plants.channel import Channel  # noqa: PLC0415  (needs MuJoCo)
    from rehab_opt.plants.contacts import Wall  # noqa: PLC0415
    from rehab_opt.plants.mujoco_arm import MujocoArm  # noqa: PLC0415

    channel = Channel(command_delay=0.003, measurement_delay=0.002, position_noise=1e-4)
    robot = MujocoArm(ur5_model(ROBOT), dt=DT, channel=channel, seed=0)
    led = PoseTracker(ROBOT, feedback=feedback, dt=DT, linear_speed=SPEED, compile=False)
    first, way = ROBOT.pose(START), np.array([0.6, 0.0, -0.8])
    robot.contacts = (Wall(first[:3, 3] + 0.03 * way, -way),)
    seen, touch, commands, forces, speeds = robot.reset(START), 0, [], [], []
    for k in range(round(seconds / DT)):
        pose, twist = first.copy(), STILL.copy()
        pose[:3, 3] += min(SPEED * k * DT, 0.15) * way
        twist[:3] = SPEED * way * (SPEED * k * DT < 0.15)
        commands.append(led.step(seen.position, pose, twist))
        seen, truth = robot.step(commands[-1].value), robot.truth
        forces.append(np.linalg.norm(truth.force))
        speeds.append(np.linalg.norm(ROBOT.jacobian(truth.position)[:3] @ truth.velocity))
        touch = touch or k * bool(truth.force.any())
        if touch and (k - touch) * DT > gone:
            robot.contacts = ()
    return touch, commands, np.array(forces), np.array(speeds)


def test_a_blocked_hand_yields_and_is_slow_when_it_comes_free() -> None:
    touch, commands, force, speed = at_a_wall(LED, gone=0.8, seconds=1.6)
    assert force.max() <= 140.0
    assert force[touch + 500 :].max() <= 60.0
    assert speed[touch + 800 :].max() <= 0.1
    first = next(k for k, each in enumerate(commands) if each.reason)
    assert touch < first <= touch + 30
    assert "held back" in commands[first].reason
    assert commands[-1].status is Status.HOLDING
    assert "does not follow" in commands[-1].reason


def by_proportional_servos(told: JointFeedback, rate: float, dt: float, stopped: float = math.inf) -> list[str]:
    """Reasons of 4 s in which the target jumps; joints move at q' = rate (q_commanded - q), and not once `stopped`."""
    led, rng = PoseTracker(ROBOT, dt=dt, feedback=told, linear_speed=0.5, compile=False), np.random.default_rng(21)
    q, late, reasons = START.copy(), [np.zeros(6)] * round(told.delay / dt), []
    behind = np.zeros(6)
    for k in range(round(4 / dt)):
        if k % round(0.8 / dt) == 0:
            pose = ROBOT.pose(START + rng.uniform(-0.6, 0.6, 6))
        command = led.step(q + 1e-4 * rng.normal(size=6), pose, STILL)
        reasons.append(command.reason)
        late.append(command.value)
        arrived = late.pop(0)
        moved = dt * arrived + (behind - arrived / rate) * -math.expm1(-rate * dt)
        q, behind = q + moved * (k * dt < stopped), behind + dt * arrived - moved
    return reasons


@pytest.mark.parametrize(("rate", "dt"), [(20.0, 0.02), (61.0, 0.005)])
def test_a_servo_without_integral_action_holds_no_free_hand_and_hides_none_that_is_held(rate: float, dt: float) -> None:
    told = JointFeedback(delay=dt, servo_hz=rate / (2 * math.pi), integral_action=False)
    assert not any("held" in each or "follow" in each for each in by_proportional_servos(told, rate, dt))
    said = ["held" in each for each in by_proportional_servos(told, rate, dt, stopped=1.75)]
    assert 1.75 < said.index(True) * dt < 1.85
    untold = by_proportional_servos(JointFeedback(delay=dt), rate, dt)  # the claim can fail
    assert any("held" in each for each in untold)


@cache
def quick() -> PoseTracker:
    return tracker(JointFeedback(delay=0.0, servo_hz=math.inf))


def stopped_at_once(numbers: Callable[[int], float | None]) -> tuple[list[Command], int]:
    """Commands to a hand at 0.2 m/s, and the tick in which its joints stand still; a number replaces q[0] of a tick."""
    led, blocked = quick(), 300
    led.reset()
    q, twist, commands = START.copy(), np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0]), []
    first = ROBOT.pose(START)
    for k in range(blocked + 60):
        pose, seen, instead = first.copy(), q.copy(), numbers(k)
        pose[:3, 3] += k * DT * twist[:3]
        seen[0] = seen[0] if instead is None else instead
        commands.append(led.step(seen, pose, twist))
        q = q + DT * commands[-1].value * (k < blocked)
    return commands, blocked


@pytest.mark.parametrize(("bad", "when"), [(math.nan, range(100, 400, 2)), (1e300, range(100, 101))])
def test_a_sample_that_is_no_number_does_not_blind_the_watch(bad: float, when: range) -> None:
    commands, blocked = stopped_at_once(lambda k: bad if k in when else None)
    first = next(k for k, each in enumerate(commands) if "held back" in each.reason)
    assert blocked < first <= blocked + 30


def test_joints_that_begin_anew_at_rest_say_that_the_acceleration_yields() -> None:
    commands, _ = stopped_at_once(lambda k: None)
    last = np.zeros(6)
    for each in commands:
        hurried = bool(np.any(np.abs(each.value - last) > ROBOT.acceleration * DT * (1 + 1e-9) + 1e-12))
        assert bool(each.relaxed & Relaxed.ACCELERATION) == hurried
        last = each.value
    assert any(each.relaxed & Relaxed.ACCELERATION for each in commands)


def test_a_joint_is_thrown_off_by_no_more_than_its_margin() -> None:
    """Of the largest acceleration, for as long as a speed takes to end: the servo's equations, integrated."""
    p, a = LED.pole, 10.0

    def thrown(ends_after: float) -> float:
        def rates(t: float, s: Array) -> list[float]:
            return [s[1], a * (t < ends_after) - 2 * p * s[1] - p * p * s[0]]

        return float(np.abs(solve_ivp(rates, (0, 0.3), np.zeros(2), max_step=1e-3, rtol=1e-6, atol=1e-9).y[0]).max())

    for speed in (0.01, 0.1, 0.5, 2.0):
        margin = float(LED.deviation(ROBOT, np.eye(6)[1] * speed))
        assert thrown(speed / a) <= margin / COUPLED * 1.001
        assert thrown(speed / a) >= margin / COUPLED * 0.6  # and not by much less
    assert float(LED.deviation(ROBOT, np.zeros(6))) == 0.0
