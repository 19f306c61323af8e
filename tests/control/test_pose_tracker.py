"""Claims about PoseTracker that a person's safety rests on, judged by plain numpy."""

import math
from pathlib import Path

import numpy as np
import pytest
import qpsolvers

from rehab_opt import DH, Limit, PoseTracker, Relaxed, SerialChain, Status, ur5
from rehab_opt.control.command import Command
from tests.failing_solvers import failing_solvers
from tests.kinematics.robot_files.known_arms import gen3
from tests.kinematics.robot_files.random_arms import urdf
from tests.refusals import refuses

START = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
REST = np.zeros(6)
GEN3 = Path(__file__).parents[2] / "problems/robots/kinova_gen3/gen3.urdf"


def tracker(chain: SerialChain | None = None, **options: object) -> PoseTracker:
    return PoseTracker(chain or ur5(), compile=False, **options)  # type: ignore[arg-type]


def moved(pose: np.ndarray, *shift: float) -> np.ndarray:
    target = pose.copy()
    target[:3, 3] += shift
    return target


def slide_arm() -> SerialChain:
    """A prismatic base with a short arm, one joint locked, one of +-3 degrees, one without limits."""
    rows = [DH(0, -math.pi / 2, prismatic=True), DH(0.3, 0.0), DH(0.25, math.pi / 2), DH(0.2, 0.0), DH(0.05, 1.0, 0.1)]
    return SerialChain(
        rows, lower=[-0.4, -2.0, 0.3, -0.05, -math.inf], upper=[0.4, 2.0, 0.3, 0.05, math.inf],
        velocity=[0.5, 2.0, 1.0, 1.5, 4.0], acceleration=[2.0, 20.0, 5.0, 8.0, math.inf],
    )  # fmt: skip


@pytest.mark.parametrize(("arm", "dt"), [("slide", 1e-1), ("slide", 1e-3), ("imported", 4e-3)])
def test_bounds_of_any_arm_hold_in_every_tick_faults_included(arm: str, dt: float, tmp_path: Path) -> None:
    """Of joints that slide, are locked, or never end; UR5s are the judge's."""
    chain, rng = slide_arm(), np.random.default_rng(7)
    if arm == "imported":
        (tmp_path / "gen3.urdf").write_text(urdf(gen3()))
        chain = SerialChain.from_urdf(tmp_path / "gen3.urdf", acceleration=5.0)
    robot, last = tracker(chain, dt=dt), np.zeros(chain.n)
    q = np.where(chain.locked, chain.lower, 0.0)
    for k in range(700):
        if k % 25 == 0:
            twist = rng.standard_normal(6) * rng.choice([0.1, 1.0, 10.0])
        told = {"q": q.copy(), "pose": chain.pose(q), "twist": twist.copy()}
        wrong = str(rng.choice(["q", "pose", "twist", "mirrored", "disabled"])) if k % 11 == 0 else ""
        if wrong in told:
            told[wrong].ravel()[-1] = rng.choice([math.nan, math.inf, -1e300])
        if wrong == "mirrored":
            told["pose"] = told["pose"].T.copy()
        command = robot.step(**told, enable=wrong != "disabled")
        v = command.value
        assert command.status.certified == (not wrong)
        assert command.reason or not wrong
        assert not command.relaxed & Relaxed.ACCELERATION
        assert wrong == "q" or not command.relaxed & Relaxed.POSITION
        assert np.all(np.abs(v) <= chain.velocity)
        assert np.all(np.abs(v - last) <= chain.acceleration * dt * (1 + 1e-9) + 1e-12)
        assert not wrong or np.all((np.abs(v) <= np.abs(last)) & (v * last >= 0.0))
        assert command.scale == 0.0 if wrong else 0.0 <= command.scale <= 1.0
        q, last = q + v * dt, v
        assert np.all((q <= chain.upper + 1e-12) & (q >= chain.lower - 1e-12))


@pytest.mark.parametrize(
    ("arm", "dt", "limited"),
    [("ur5", 2e-2, False), ("gen3", 5e-3, True)],
)
def test_no_command_moves_the_hand_faster_than_its_bound_wherever_targets_jump(
    arm: str, dt: float, limited: bool
) -> None:
    """Joints that accelerated as they might were out of step: hands went at up to twice `linear_speed`.

    Beside a limit that is never near, too.
    """
    limits = [Limit(lambda chain, q: chain.pose_expression(q)[2, 3] + 10.0)] if limited else []
    chain = ur5(acceleration=np.full(6, 3.0))
    if arm == "gen3":
        chain = SerialChain.from_urdf(GEN3, tip="end_effector_link", acceleration=2.0)
    rng, most = np.random.default_rng(65), [0.0, 0.0]
    lower, upper = np.maximum(chain.lower, -2.0), np.minimum(chain.upper, 2.0)
    for _ in range(2):
        robot = tracker(chain, dt=dt, linear_speed=0.25, angular_speed=1.0, limits=limits)
        q = rng.uniform(0.5 * lower, 0.5 * upper)
        for k in range(round(6.0 / dt)):
            if k % round(1.5 / dt) == 0:
                target = chain.pose(rng.uniform(lower, upper))
            value = robot.step(q, target, REST).value
            for part in (0.0, 0.5, 1.0):
                hand = chain.jacobian(q + part * dt * value) @ value
                most[0] = max(most[0], float(np.linalg.norm(hand[:3])))
                most[1] = max(most[1], float(np.linalg.norm(hand[3:])) * (part == 0.0))
            q = q + dt * value
    assert 0.24 < most[0] <= 0.25 * (1 + 5e-3)  # beside a stretched elbow it bends faster than accelerations slow it
    assert 0.9 < most[1] <= 1.0 + 1e-4


def test_a_target_that_jumps_is_come_to_and_not_passed() -> None:
    """A Gen3 that accelerates at 2 rad/s^2 swung past it by 30 of 50 mm, to and fro for three seconds."""
    rng, dt = np.random.default_rng(62), 5e-3
    chain = SerialChain.from_urdf(GEN3, tip="end_effector_link", acceleration=2.0)
    q = np.array([0.0, 0.5, 0.0, 1.5, 0.0, 1.0, 0.0]) + rng.uniform(-0.2, 0.2, chain.n)
    robot, way = tracker(chain, dt=dt, linear_speed=0.25), rng.normal(size=3)
    target = moved(chain.pose(q), *(way / np.linalg.norm(way) * rng.uniform(0.02, 0.06)))
    off, back = [], 0.0
    for _ in range(round(5.0 / dt)):
        command = robot.step(q, target, REST)
        assert command.status.certified
        q = q + dt * command.value
        off.append(float(np.linalg.norm(chain.pose(q)[:3, 3] - target[:3, 3])))
        back = max(back, off[-1] - min(off))
    assert off[-1] < 1e-5
    assert back < 1e-3 * off[0]


def test_who_lets_go_of_the_enable_switch_does_not_have_the_hand_go_faster() -> None:
    """Joints that cancelled each other out stopped one after the other: a hand of 0.05 m/s went at up to 0.2.

    The arm rests as soon as the joint that needs longest can.
    """
    limits = [Limit(lambda chain, q: chain.pose_expression(q)[2, 3] + 10.0)]
    chain = SerialChain.from_urdf(GEN3, tip="end_effector_link", acceleration=2.0)
    rng, dt, most, before = np.random.default_rng(66), 5e-3, 0.0, 0.0
    lower, upper = np.maximum(chain.lower, -2.5), np.minimum(chain.upper, 2.5)
    robot = tracker(chain, dt=dt, linear_speed=0.05, limits=limits)
    for _ in range(12):
        robot.reset()
        q = rng.uniform(0.8 * lower, 0.8 * upper)
        target = chain.pose(np.clip(q + rng.normal(0.0, 0.8, chain.n), lower, upper))
        for _ in range(int(rng.integers(20, 200))):
            value = robot.step(q, target, REST).value
            q = q + dt * value
        at_least = math.ceil(float(np.max(np.abs(value) / chain.acceleration)) / dt - 1e-6)
        for _ in range(at_least):
            assert value.any()
            before = max(before, float(np.linalg.norm((chain.jacobian(q) @ nearest_to_rest(chain, value, dt))[:3])))
            command = robot.step(q, target, REST, enable=False)
            value = command.value
            most = max(most, *(np.linalg.norm((chain.jacobian(q + part * dt * value) @ value)[:3]) for part in (0, 1)))
            assert Relaxed.ACCELERATION not in command.relaxed
            q = q + dt * value
        assert not value.any()
    assert most <= 0.05 * (1 + 5e-3)
    assert before > 0.052  # what joints that all brake as they can would make of it


def nearest_to_rest(chain: SerialChain, velocity: np.ndarray, dt: float) -> np.ndarray:
    return np.sign(velocity) * np.maximum(np.abs(velocity) - chain.acceleration * dt, 0.0)


def test_the_backup_answers_when_the_primary_is_made_to_fail() -> None:
    chain = ur5()
    with failing_solvers() as failures:
        robot, plain = tracker(chain), tracker(chain)
    failures.primary = True
    command = robot.step(START, chain.pose(START), [0.05, 0, 0, 0, 0, 0])
    assert command.status is Status.BACKUP
    assert command.solver == "daqp"
    assert "qrqp" in command.reason
    failures.primary = False
    expected = plain.step(START, chain.pose(START), [0.05, 0, 0, 0, 0, 0])
    assert expected.status is Status.OK
    np.testing.assert_allclose(command.value, expected.value, atol=1e-6)


def test_the_safe_command_answers_when_every_solver_fails() -> None:
    chain = ur5()
    with failing_solvers() as failures:
        robot, last = tracker(chain), np.full(6, 0.1)
    robot.reset(last)
    failures.every = True
    command = robot.step(START, chain.pose(START), REST)
    assert command.status is Status.BRAKING
    assert "no solver" in command.reason
    np.testing.assert_allclose(command.value, last - chain.acceleration * robot.dt, atol=1e-12)


def test_the_qp_can_be_inspected_and_solved_elsewhere() -> None:
    """Where accelerations hold nothing back the command is the QP's answer, here with a joint kept before its limit."""
    chain = ur5(acceleration=1e4, upper=START + [0.01, *[1.0] * 5])
    robot, twist = tracker(chain), np.array([0.0, -0.3, 0.1, 0.0, 0.0, 0.0])
    robot.step(START, chain.pose(START), twist)
    problem = robot.to_qpsolvers(START, chain.pose(START), twist)
    answer = qpsolvers.solve_problem(problem, solver="daqp", primal_tol=1e-12, dual_tol=1e-12).x
    robot.reset()
    command = robot.step(START, chain.pose(START), twist)
    assert command.solver != "closed form"
    np.testing.assert_allclose(command.value, answer[:6], atol=1e-7)


def test_a_command_is_its_own_and_frozen() -> None:
    robot, pose = tracker(), ur5().pose(START)
    first = robot.step(START, pose, [0.1, 0, 0, 0, 0, 0])
    kept = first.value.copy()
    robot.step(START, pose, [0.0, 0.3, 0, 0, 0, 0])
    assert np.array_equal(first.value, kept)
    assert isinstance(first, Command)
    with pytest.raises(ValueError, match="read-only"):
        first.value[0] = 1.0
    with pytest.raises(AttributeError):
        first.status = Status.OK  # type: ignore[misc]


def test_settings_that_cannot_be_used_are_named() -> None:
    settings: list[tuple[str, object]] = [
        ("dt", 0.0), ("dt", math.nan), ("dt", -1e-3), ("dt", "fast"), ("gain", 0.0), ("gain", math.inf),
        ("linear_speed", -1.0), ("angular_speed", math.nan), ("recovery_speed", 0.0), ("recovery_speed", 2.0),
        ("tolerance", 0.0), ("tolerance", math.nan), ("solver", "simplex"), ("backup", "none"),
        ("posture", [0.0] * 5), ("task_weights", [1, 1, 1, -1, 0, 0]), ("max_age", -1.0),
    ]  # fmt: skip
    refuses(tracker, *(({name: value}, name) for name, value in settings))
    for arm in ("ur5", None, SerialChain):
        refuses(PoseTracker, ((arm,), "chain = ", " a SerialChain"))


def test_a_wrong_shape_is_a_typed_error_of_the_caller() -> None:
    usual = {"q": START, "pose": np.eye(4), "twist": REST}
    shapes: dict[str, list[object]] = {
        "q": [START[:5], START.reshape(1, 6), 1.0, None],
        "pose": [np.eye(3), np.eye(4).reshape(16), np.eye(4).reshape(2, 8)],
        "twist": [REST[:3], ["a"] * 6, REST + 1j],
    }
    rows = [({**usual, name: value}, name, "real numbers of shape") for name, each in shapes.items() for value in each]
    refuses(tracker().step, *rows)


def test_only_one_truth_value_enables_and_stamps_must_go_on() -> None:
    robot, pose, twist = tracker(max_age=0.02), ur5().pose(START), [0.1, 0, 0, 0, 0, 0]
    off: list[object] = [False, 0, None, math.nan, np.False_, np.array([True, True]), "yes", 2, [True]]
    for enable in off:
        assert robot.step(START, pose, twist, enable=enable).reason == "not enabled"
    for enable in (True, 1, np.True_):
        assert robot.step(START, pose, REST, enable=enable).status is Status.OK
    assert robot.step([10**400, 0, 0, 0, 0, 0], pose, REST).status is Status.HOLDING
    assert robot.step(START, pose, REST, stamp=1.0).status is Status.OK
    assert "repeated" in robot.step(START, pose, REST, stamp=1.0).reason
    assert robot.step(START, pose, REST).reason == "stamp is missing"
    slow = [robot.step(START, pose, REST, stamp=1.002 + 1e-4 * (k + 1)).status for k in range(60)]
    assert slow[0] is Status.OK
    assert slow[-1] is Status.HOLDING
