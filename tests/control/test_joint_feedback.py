"""Claims about acting on where the joints are led: late servos, noisy encoders, joints that do not follow."""

from __future__ import annotations

import math
from collections import deque
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rehab_opt import JointFeedback, PoseTracker, ur5
from rehab_opt.control.followed_joints import FollowedJoints
from rehab_opt.control.stopping import gentle_speed, velocity_bounds
from tests.refusals import refuses

Array = NDArray[np.float64]
START, DT = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), 1e-3
ROBOT = ur5(acceleration=np.full(6, 10.0))
STILL = np.zeros(6)


def tracker(**feedback: float) -> PoseTracker:
    return PoseTracker(ROBOT, feedback=JointFeedback(servo_hz=math.inf, **feedback), dt=DT, compile=False)


def test_joints_that_move_as_commanded_get_the_commands_of_measured_positions() -> None:
    led, plain, q = tracker(delay=0.0), PoseTracker(ROBOT, dt=DT, compile=False), START.copy()
    rng = np.random.default_rng(3)
    for k in range(400):
        if k % 100 == 0:
            pose, twist = ROBOT.pose(START + rng.uniform(-0.5, 0.5, 6)), 0.1 * rng.normal(size=6)
        command = plain.step(q, pose, twist)
        np.testing.assert_allclose(led.step(q, pose, twist).value, command.value, rtol=0, atol=1e-9)
        q = q + DT * command.value


def servo_rates(told: JointFeedback, s: Array, u: float) -> list[float]:
    """Of position, velocity and position error of a servo, see `JointFeedback.integral_action`."""
    p = told.pole
    if told.integral_action:
        return [s[1], 2 * p * (u - s[1]) + p * p * s[2], u - s[1]]
    return [p * s[2], 0.0, u - p * s[2]]


@pytest.mark.parametrize(("integral_action", "dt"), [(True, 0.02), (False, 2e-3)])
def test_the_servo_of_the_model_is_a_proportional_loop_with_and_without_integral_action(
    dt: float, integral_action: bool
) -> None:
    """Beside the loop's differential equations, integrated by another library."""
    told = JointFeedback(delay=0.0, servo_hz=17.0, integral_action=integral_action, correction=1e-9, tolerance=1e3)
    commands, joints = np.random.default_rng(6).normal(size=(40, 1)), FollowedJoints(told, 1, dt=dt)
    state = np.zeros(3)
    memory, *_ = joints.tick(joints.start(0.0), 0.0, 0.0)
    for u in commands:

        def rates(_: float, s: Array, u: float = u[0]) -> list[float]:
            return servo_rates(told, s, u)

        state = solve_ivp(rates, (0, dt), state, rtol=1e-10, atol=1e-12).y[:, -1]
        memory, q, *_ = joints.tick(memory, state[0], u)
        assert float(memory[joints.memory["error"]]) == pytest.approx(0.0, abs=1e-7)
        assert float(q) == pytest.approx(state[0] + state[2], abs=1e-7)  # where it comes to: the sum of the commands


@pytest.mark.parametrize(("delay", "dt"), [(0.0, 0.005), (0.005, 0.01), (0.013, 0.001), (0.03, 0.02)])
@pytest.mark.parametrize("integral_action", [True, False])
def test_a_delay_that_ends_within_a_tick_is_followed_exactly(delay: float, dt: float, integral_action: bool) -> None:
    """Rounded to ticks, 5 ms were none at 10 and 20 ms: a free hand that sped up was behind, and taken for held."""
    told = JointFeedback(delay=delay, integral_action=integral_action, correction=1e-9, tolerance=1e3)
    commands, joints = np.random.default_rng(8).normal(size=60), FollowedJoints(told, 1, dt=dt)
    state, now, acts = np.zeros(3), 0.0, 0.0
    arrivals = deque((k * dt + delay, u) for k, u in enumerate(commands))
    memory, *_ = joints.tick(joints.start(0.0), 0.0, 0.0)

    def go_on(seconds: float) -> None:
        nonlocal state
        if seconds > 1e-12:
            rates = lambda _, s: servo_rates(told, s, acts)  # noqa: E731
            state = solve_ivp(rates, (0, seconds), state, rtol=1e-10, atol=1e-12).y[:, -1]

    for k, u in enumerate(commands):
        while arrivals and arrivals[0][0] < (k + 1) * dt - 1e-9:
            at, command = arrivals.popleft()
            go_on(at - now)
            now, acts = at, command
        go_on((k + 1) * dt - now)
        now = (k + 1) * dt
        memory, q, *_ = joints.tick(memory, state[0], u)
        assert float(memory[joints.memory["error"]]) == pytest.approx(0.0, abs=1e-7)
        assert float(q) == pytest.approx(dt * commands[: k + 1].sum(), abs=1e-7)  # where all commands lead


def test_what_cannot_be_is_named() -> None:
    settings: list[tuple[str, Any]] = [
        ("delay", math.nan), ("correction", 0.0), ("tolerance", "x"), ("integral_action", 1), ("integral_action", None),
    ]  # fmt: skip
    refuses(JointFeedback, *(({name: value}, f"feedback.{name}") for name, value in settings))
    refuses(
        JointFeedback,
        ({"delay": -1}, "feedback.delay = -1: expected a number of at least 0 and at most 1000"),
        ({"contact": 5000}, "feedback.contact = 5000: expected", "above 0 and at most 1000"),
        ({"servo_hz": 0}, "feedback.servo_hz = 0: expected a number above 0"),
    )
    late = JointFeedback(delay=0.5)
    make = partial(PoseTracker, ROBOT, dt=DT, compile=False)
    refuses(make, ({"feedback": 0.005}, "feedback = 0.005", "a JointFeedback"))
    refuses(make, ({"feedback": late}, "feedback.delay = 0.5", "128 ticks"))


def test_speed_towards_a_limit_never_falls_with_the_room_and_takes_at_most_seven_tenths_of_the_acceleration() -> None:
    acceleration, approach = 3.0, 8.0
    room = np.linspace(0.0, 1.0, 20_001)
    x = ca.SX.sym("x")
    speeds = ca.Function("f", [x], [gentle_speed(x, ca.DM(acceleration), approach)]).map(len(room))(room[None])
    v = speeds.full().ravel()
    deceleration = v[1:] * np.diff(v) / np.diff(room)
    assert (np.diff(v) > 0).all()
    assert deceleration.max() <= 0.7 * acceleration * (1 + 1e-3)
    assert deceleration[-1] == pytest.approx(0.7 * acceleration, rel=1e-3)
    np.testing.assert_allclose(v[room < 0.02], approach * room[room < 0.02])


def test_a_joint_at_either_limit_is_not_outside_and_may_leave_it_at_its_full_speed() -> None:
    arm, dt = ur5(), 0.01
    q, last = ca.SX.sym("q", 6), ca.SX.sym("last", 6)
    bounds = velocity_bounds(arm, q, last, dt=dt, recovery_speed=0.1)
    outputs = [bounds.outside, bounds.hard_lower, bounds.hard_upper]
    function = ca.Function("bounds", [q, last], [ca.densify(ca.SX(each)) for each in outputs])
    for at, way in ((arm.lower, 1.0), (arm.upper, -1.0)):
        outside, lower, upper = (each.full().ravel() for each in function(at, np.zeros(6)))
        assert not outside.any()
        np.testing.assert_allclose(upper if way > 0 else lower, way * arm.velocity)
        np.testing.assert_allclose(lower if way > 0 else upper, 0.0, atol=1e-12)
