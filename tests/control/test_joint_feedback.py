"""Claims about acting on where the joints are led: late servos, noisy encoders, joints that do not follow."""

from __future__ import annotations

import math
from collections import deque

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rehab_opt import ConfigurationError, JointFeedback, PoseTracker, Status, ur5
from rehab_opt.control.followed_joints import FollowedJoints
from rehab_opt.control.stopping import gentle_speed, velocity_bounds

Array = NDArray[np.float64]
START, DT = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), 1e-3
ROBOT = ur5(acceleration=np.full(6, 10.0))
STILL = np.zeros(6)


class LateJoints:
    """Joints that move as commanded, but late, and encoders that are late too; some do not follow."""

    def __init__(self, late: int, seen_late: int, rng: np.random.Generator) -> None:
        self.q, self.rng = START.copy(), rng
        self.pipe, self.told = deque([np.zeros(6)] * late), deque([START.copy()] * seen_late)
        self.gain, self.frozen = np.ones(6), np.zeros(6, dtype=bool)
        self.shown = START.copy()

    def step(self, command: Array) -> Array:
        self.pipe.append(command)
        self.q = self.q + DT * self.gain * self.pipe.popleft()
        self.shown = np.where(self.frozen, self.shown, self.q + 1e-4 * self.rng.normal(size=6))
        self.told.append(self.shown)
        return self.told.popleft()


def tracker(**feedback: float) -> PoseTracker:
    return PoseTracker(ROBOT, feedback=JointFeedback(servo_hz=math.inf, **feedback), dt=DT, compile=False)


def turned(joint: int, by: float) -> Array:
    """(4, 4) pose of the hand after one joint has turned."""
    return ROBOT.pose(START + by * np.eye(6)[joint])


def test_joints_that_move_as_commanded_get_the_commands_of_measured_positions() -> None:
    led, plain, q = tracker(delay=0.0), PoseTracker(ROBOT, dt=DT, compile=False), START.copy()
    rng = np.random.default_rng(3)
    for k in range(400):
        if k % 100 == 0:
            pose, twist = ROBOT.pose(START + rng.uniform(-0.5, 0.5, 6)), 0.1 * rng.normal(size=6)
        command = plain.step(q, pose, twist)
        np.testing.assert_allclose(led.step(q, pose, twist).value, command.value, rtol=0, atol=1e-9)
        q = q + DT * command.value


@pytest.mark.parametrize("delay", [0.003, 0.008, 0.05])
def test_late_joints_come_to_rest_where_the_hand_is_asked(delay: float) -> None:
    ticks = round(delay / DT)
    joints, led = LateJoints(ticks - ticks // 3, ticks // 3, np.random.default_rng(1)), tracker(delay=delay)
    seen, pose, velocities = START, turned(1, 0.3), []
    for _ in range(4000):
        command = led.step(seen, pose, STILL)
        assert command.status.certified
        velocities.append(command.value)
        seen = joints.step(command.value)
    hand = ROBOT.pose(joints.q)
    assert np.linalg.norm(hand[:3, 3] - pose[:3, 3]) < 1e-3
    assert np.abs(velocities[-500:]).max() < 2e-3  # and the noise of the encoders does not shake it


def test_without_it_a_late_robot_shakes() -> None:
    """The claim above can fail: the same robot, its measured positions believed."""
    joints, plain = LateJoints(13, 7, np.random.default_rng(1)), PoseTracker(ROBOT, dt=DT, compile=False)
    seen, pose, velocities = START, turned(1, 0.3), []
    for _ in range(4000):
        velocities.append(plain.step(seen, pose, STILL).value)
        seen = joints.step(velocities[-1])
    assert np.abs(velocities[-500:]).max() > 5 * 2e-3


@pytest.mark.parametrize("what", ["frozen encoder", "blocked joint", "wrong sign"])
@pytest.mark.parametrize("joint", [0, 2])
def test_a_joint_that_does_not_follow_brakes_and_is_named(what: str, joint: int) -> None:
    feedback = JointFeedback(servo_hz=math.inf, delay=0.005)
    led = PoseTracker(ROBOT, feedback=feedback, dt=DT, compile=False)
    joints, seen, way, speed, ticks = LateJoints(3, 2, np.random.default_rng(2)), START, 0.0, 0.2, 0
    while way < 0.2:  # along an arc of that joint, at a steady speed
        way += speed * DT
        command = led.step(seen, turned(joint, way), STILL)
        assert command.status.certified
        seen = joints.step(command.value)
    if what == "frozen encoder":
        joints.frozen[:] = True
    else:
        joints.gain[joint] = 0.0 if what == "blocked joint" else -1.0
    while command.status.certified and ticks < 1000:
        ticks, way = ticks + 1, way + speed * DT
        seen = joints.step(command.value)
        command = led.step(seen, turned(joint, way), STILL)
    assert command.reason.startswith(f"{ROBOT.names[joint]} does not follow")
    assert ticks * DT <= 0.1 + feedback.patience + feedback.tolerance / speed
    speeds = [np.abs(command.value).max()]
    for _ in range(300):
        seen = joints.step(command.value)
        command = led.step(seen, turned(joint, way), STILL)
        speeds.append(np.abs(command.value).max())
        assert command.status in (Status.BRAKING, Status.HOLDING)
    assert speeds[-1] == 0.0
    assert np.diff(speeds).max() <= 1e-9


@pytest.mark.parametrize("every", [1, 7, 60])
def test_samples_that_are_none_do_not_hide_a_fault(every: int) -> None:
    led, joints = tracker(delay=0.005), LateJoints(3, 2, np.random.default_rng(11))
    joints.gain[0] = -1.0
    seen, reasons = START, []
    for k in range(3000):
        broken = np.where((np.arange(6) == 5) & (k % every == 0) & (every > 1), math.nan, seen)
        command = led.step(broken, turned(0, 0.25), STILL)
        reasons.append(command.reason)
        seen = joints.step(command.value)
        if k == 1500:
            there = joints.q.copy()
    fault = f"{ROBOT.names[0]} does not follow: "
    assert len({each for each in reasons if each.startswith(fault)}) == 1  # the joint and its error then, for ever
    assert command.reason.startswith(fault) or "not a usable number" in command.reason
    assert abs(joints.q[0]) < 0.3
    np.testing.assert_array_equal(joints.q, there)


@pytest.mark.parametrize("bad", [1.0, 100.0, 1e4])
def test_one_sample_that_lies_moves_nothing(bad: float) -> None:
    led, joints, seen, pose = (
        tracker(delay=0.002),
        LateJoints(1, 1, np.random.default_rng(12)),
        START,
        ROBOT.pose(START),
    )
    for k in range(600):
        command = led.step(seen + bad * (k == 300) * np.eye(6)[0], pose, STILL)
        seen = joints.step(command.value)
        assert command.status.certified
        assert np.abs(command.value).max() < 2e-3


def test_a_fault_rests_until_reset_and_a_start_in_motion_is_none() -> None:
    led, joints = tracker(delay=0.005), LateJoints(3, 2, np.random.default_rng(8))
    joints.gain[2] = 0.0
    seen = START
    for _ in range(3000):
        command = led.step(seen, turned(2, 0.3), STILL)
        seen = joints.step(command.value)
    assert command.status is Status.HOLDING
    assert command.reason.startswith(f"{ROBOT.names[2]} does not follow")
    moving = 0.3 * np.eye(6)[0]
    joints = LateJoints(3, 2, np.random.default_rng(9))
    joints.pipe.extend([moving] * 3)
    for _ in range(3):
        joints.pipe.popleft()
    led.reset(velocity=moving)
    seen, start = START, ROBOT.jacobian(START) @ moving
    for k in range(200):
        command = led.step(seen, ROBOT.pose(START + k * DT * moving), start)
        assert command.status.certified
        seen = joints.step(command.value)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e9])
def test_a_position_that_is_no_number_brakes(bad: float) -> None:
    led, joints, seen = tracker(delay=0.002), LateJoints(1, 1, np.random.default_rng(5)), START
    for _ in range(300):
        seen = joints.step(led.step(seen, turned(0, 0.3), STILL).value)
    broken = np.where(np.arange(6) == 3, bad, seen)
    command = led.step(broken, turned(0, 0.3), STILL)
    assert command.status is Status.BRAKING
    assert "q[3]" in command.reason
    assert "not a usable number" in command.reason
    assert led.step(seen, turned(0, 0.3), STILL).status.certified


def servo_rates(told: JointFeedback, s: Array, u: float) -> list[float]:
    """Of position, velocity and position error of a servo, see `JointFeedback.integral_action`."""
    p = told.pole
    if told.integral_action:
        return [s[1], 2 * p * (u - s[1]) + p * p * s[2], u - s[1]]
    return [p * s[2], 0.0, u - p * s[2]]


@pytest.mark.parametrize("integral_action", [True, False])
@pytest.mark.parametrize("dt", [5e-4, 2e-3, 0.02])
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


@pytest.mark.parametrize("dt", [0.001, 0.005, 0.01, 0.02])
@pytest.mark.parametrize("delay", [0.0, 0.0025, 0.005, 0.013, 0.03])
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


def test_on_a_simulated_arm_a_limit_is_held_without_shaking() -> None:
    pytest.importorskip("mujoco")
    from rehab_opt.plants.arm_model import ur5_model  # noqa: PLC0415
    from rehab_opt.plants.channel import Channel  # noqa: PLC0415  (needs MuJoCo)
    from rehab_opt.plants.mujoco_arm import MujocoArm  # noqa: PLC0415

    def held(feedback: JointFeedback | None) -> tuple[float, float]:
        """[mrad] beyond the limits, from the first approach on; to and fro in the last second."""
        arm = ROBOT.with_limits(lower=START - 0.6, upper=START + 0.6)
        led = PoseTracker(arm, feedback=feedback, dt=DT, compile=False)
        channel = Channel(command_delay=0.003, measurement_delay=0.002, position_noise=1e-4)
        plant, q = MujocoArm(ur5_model(arm), dt=DT, channel=channel, seed=7), []
        seen, pose = plant.reset(START), arm.pose(START + [0.1, -0.1, 0.8, 0.1, 0.0, 0.1])
        for _ in range(3000):
            seen = plant.step(led.step(seen.position, pose, STILL).value)
            q.append(plant.truth.position)
        return 1e3 * float(np.abs(np.array(q) - START).max() - 0.6), 1e3 * float(np.ptp(q[-1000:], axis=0).max())

    beyond, shaking = held(JointFeedback(delay=0.005))
    assert beyond <= 0.5
    assert shaking <= 0.3
    beyond, shaking = held(None)
    assert beyond > 2.0
    assert shaking > 2.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("delay", -0.1),
        ("delay", math.nan),
        ("servo_hz", 0.0),
        ("correction", 0.0),
        ("tolerance", "x"),
        ("integral_action", 1),
        ("integral_action", None),
    ],
)
def test_a_number_that_cannot_be_is_named(name: str, value: object) -> None:
    with pytest.raises(ConfigurationError, match=f"feedback.{name}"):
        JointFeedback(**{name: value})  # type: ignore[arg-type]


def test_what_would_have_been_taken_is_said() -> None:
    """A delay of -1 was "expected above -1e-12", a contact of 5000 "above 0"."""
    with pytest.raises(
        ConfigurationError, match=r"feedback\.delay = -1: expected a number of at least 0 and at most 1000"
    ):
        JointFeedback(delay=-1)
    with pytest.raises(ConfigurationError, match=r"feedback\.contact = 5000: expected .* above 0 and at most 1000"):
        JointFeedback(contact=5000)
    with pytest.raises(ConfigurationError, match=r"feedback\.servo_hz = 0: expected a number above 0$"):
        JointFeedback(servo_hz=0)


def test_what_is_no_feedback_is_named() -> None:
    with pytest.raises(ConfigurationError, match=r"feedback = 0\.005.*a JointFeedback"):
        PoseTracker(ROBOT, feedback=0.005, compile=False)  # type: ignore[arg-type]


def test_a_delay_of_too_many_ticks_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"feedback\.delay = 0\.5.*128 ticks"):
        PoseTracker(ROBOT, feedback=JointFeedback(delay=0.5), dt=DT, compile=False)


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
