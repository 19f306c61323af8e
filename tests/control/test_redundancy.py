"""Claims about RedundancyResolver that a user's safety rests on, judged by plain numpy."""

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rehab_opt import Limit, RedundancyResolver, Relaxed, SerialChain, Status, ardis
from rehab_opt.control.chair_and_arm import ChairAndArm
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.kinematics.drive import Differential
from rehab_opt.kinematics.mobile_arm import MobileArm
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.symbolic import shared
from tests.control.redundancy_campaign import hand_twist
from tests.failing_solvers import failing_solvers
from tests.judge.numbering import seed_of_the_code
from tests.refusals import refuses

Array = NDArray[np.float64]

UNHURRIED = {"acceleration": math.inf}
DRIVES = ("mecanum", "differential")
EVERY_ROW = ("x", "y", "z", "rx", "ry", "rz", "roll7")


MADE: dict[str, RedundancyResolver] = {}
"""By their options."""


@pytest.fixture(scope="module", autouse=True)
def _let_go() -> Iterator[None]:
    yield
    MADE.clear()


def resolver(**options: object) -> RedundancyResolver:
    """As new; making one takes longer than most tests."""
    key = repr(sorted(options.items()))
    robot = MADE.setdefault(key, MADE.get(key) or new(**options))
    robot.obstacles = options.get("obstacles", ())  # type: ignore[assignment]
    robot.reset()
    return robot


def new(robot: MobileArm | None = None, **options: object) -> RedundancyResolver:
    options = {"compile": False, "row_sets": [("x", "y", "z")], **options}
    return RedundancyResolver(robot or ardis(), **options)  # type: ignore[arg-type]


@cache
def light() -> MobileArm:
    """Without acceleration bounds, so that a command is the QP's answer."""
    return ardis(**UNHURRIED)  # type: ignore[arg-type]


def unhurried(drive: str) -> RedundancyResolver:
    return resolver(robot=light(), drive=drive, keep_out=False)


def posture(rng: np.random.Generator, robot: MobileArm, fraction: float = 1.0) -> np.ndarray:
    middle = (robot.chain.lower[3:] + robot.chain.upper[3:]) / 2
    half = fraction * (robot.chain.upper[3:] - robot.chain.lower[3:]) / 2
    return np.concatenate([rng.uniform(-3, 3, 3), middle + half * rng.uniform(-1, 1, 4)])


# ---------------------------------------------------------------------------------------------- the published law
@pytest.mark.parametrize(("drive", "frame"), [("mecanum", "world"), ("differential", "chassis")])
def test_with_no_bound_active_the_command_is_the_published_law(drive: str, frame: str) -> None:
    rng, robot, compared = np.random.default_rng(seed_of_the_code()), unhurried(drive), 0
    law = PseudoinverseLaw(robot.robot, drive=drive)  # type: ignore[arg-type]
    sets = [tuple(str(each) for each in rng.permutation(EVERY_ROW)[: 1 + k % 3]) for k in range(4)]
    for k in range(40):
        rows = sets[k % len(sets)]  # each is made when it is first asked for
        q, twist = posture(rng, robot.robot, 0.8), 0.05 * rng.standard_normal(len(rows))
        robot.reset()
        if np.linalg.cond(law.task_jacobian(q, rows, frame)) > 1e4:
            continue
        published = law.rate(q, twist, rows, frame)
        excess = law.excess(q, published, np.zeros(7), robot.dt)
        # Joints stop at their limits by themselves; without acceleration bounds within one tick.
        if max(excess.position, excess.velocity, excess.wheels) > -1e-3:
            continue
        command = robot.step(q, twist, rows, frame)
        np.testing.assert_allclose(command.value, published, rtol=0, atol=1e-9)
        assert command.relaxed == Relaxed.NOTHING
        assert command.scale == 1.0
        compared += 1
    assert compared > 20


# ----------------------------------------------------------------------------------------------- speed and direction
@pytest.mark.parametrize("drive", DRIVES)
def test_a_hand_that_must_slow_down_keeps_its_direction_within_a_microradian(drive: str) -> None:
    rng, robot, slowed = np.random.default_rng(2), unhurried(drive), 0
    for _ in range(150):
        q, twist = posture(rng, robot.robot, 0.9), rng.standard_normal(3) * rng.choice([0.3, 1.0, 10.0])
        robot.reset()
        command = robot.step(q, twist)
        hand = hand_twist(robot.robot, q, command.value, ("x", "y", "z"), "chassis")
        along = hand @ twist / np.linalg.norm(twist)
        if along < 1e-3:
            continue
        slowed += command.scale < 0.99
        assert np.linalg.norm(np.cross(hand, twist)) / np.linalg.norm(twist) <= 1e-6 * along
        assert command.scale == pytest.approx(along / np.linalg.norm(twist), rel=1e-6, abs=2e-3)
    assert slowed > 50


@pytest.mark.parametrize("drive", DRIVES)
def test_a_hand_that_creeps_goes_on_where_the_chair_s_turn_helps_and_else_the_chair_stays_slow(drive: str) -> None:
    """A level forearm that only the chair can roll: by the sine of its slope, at the chair's full turn."""
    nothing, free = 1e-6, np.full(3, math.inf)
    stiff = ardis(lower=[*-free, -2, *[-nothing] * 3], upper=[*free, 2, *[nothing] * 3])
    robot, roll = new(stiff, drive=drive, row_sets=[("z", "roll7")], keep_out=False), 0.06
    for slope, worth in ((3e-3, True), (1e-3, False)):
        possible = math.sin(slope) * stiff.chain.velocity[2] / roll
        q = np.array([0.0, 0.0, 0.0, slope, 0.0, 0.0, 0.0])
        robot.reset()
        for _ in range(300):
            command = robot.step(q, [0.0, roll], ("z", "roll7"))
            q = q + 0.01 * command.value
        assert 0.02 < possible < 0.06 if worth else possible < 0.02
        assert command.scale > 0.95 * possible if worth else abs(command.value[2]) < 0.2 * stiff.chain.velocity[2]


def test_an_arm_led_to_rest_at_a_singular_posture_follows_the_reversed_stick() -> None:
    """Not into the ten degrees to a joint limit beyond it, where rounding led it; its hand gets half of the command."""
    robot, twist = resolver(drive="fixed"), [0.0529, 0.1291, 0.0021]
    q = np.array([0.0, 0.0, 0.0, -1.386, -0.363, -0.144, 0.412])
    fastest = 0.0
    for k in range(1400):
        command = robot.step(q, np.array(twist) * (1 if k < 1000 else -1))
        q = q + robot.dt * command.value
        if k == 999:
            assert command.status is Status.BLOCKED
            assert np.abs(command.value).max() < 0.01
            law = PseudoinverseLaw(robot.robot, drive="fixed").rate(q, np.array(twist), ("x", "y", "z"))
            assert 1 / np.max(np.abs(law[3:]) / robot.robot.chain.velocity[3:]) == pytest.approx(0.01)  # of the command
        fastest = max(fastest, command.scale if k >= 1000 else 0.0)
    assert fastest > 0.5


def test_the_answer_is_the_qp_s_by_another_solver() -> None:
    robot, rng = unhurried("mecanum"), np.random.default_rng(4)
    for _ in range(60):
        q, twist = posture(rng, robot.robot, 0.9), rng.standard_normal(3) * 0.8
        robot.reset()
        problem = robot.to_qpsolvers(q, twist)
        command = robot.step(q, twist)
        other = qpsolvers.solve_problem(problem, solver="proxqp", eps_abs=1e-11, eps_rel=0.0)
        if other.found:
            np.testing.assert_allclose(robot.robot.chassis_velocity(q, command.value), other.x[:7], atol=2e-5)


# --------------------------------------------------------------------------------------------------- zero commands
@given(st.integers(0, 10**6), st.sampled_from([1e-3, 2e-2]), st.just("mecanum"))
@settings(max_examples=12)
def test_no_command_while_moving_stops_in_as_many_ticks_as_the_slowest_joint_needs(
    seed: int, dt: float, drive: str
) -> None:
    rng = np.random.default_rng(seed)
    robot = stopper(drive, dt)
    chain, q = robot.robot.chain, posture(rng, robot.robot, 0.5)
    moving = 0.3 * rng.uniform(-1, 1, 7) * chain.velocity
    moving[1] *= drive == "mecanum"
    robot.reset(robot.robot.world_velocity(q, moving), heading=q[2])
    allowed = math.ceil(np.max(np.abs(moving) / (chain.acceleration * dt)) - 1e-9)
    for _ in range(allowed):
        last = robot.chassis_velocity
        command = robot.step(q, [0.0, 0.0, 0.0])
        assert command.status is Status.OK
        assert np.all(np.abs(robot.chassis_velocity - last) <= chain.acceleration * dt * (1 + 1e-9) + 1e-12)
        q = q + command.value * dt
    assert not command.value.any()


def stopper(drive: str, dt: float) -> RedundancyResolver:
    return resolver(drive=drive, dt=dt, keep_out=False)


def with_a_place() -> RedundancyResolver:
    return resolver(max_obstacles=1, keep_out=False)


# ------------------------------------------------------------------------------------------------ rows and frames
@pytest.mark.parametrize("drive", DRIVES)
def test_turning_or_shifting_the_scene_changes_nothing_in_the_chair_s_frame(drive: str) -> None:
    walls = [HalfPlane((1, 0), 1.2), Disc((0.9, 0.8), 0.2)]
    turn, shift = 2.1, np.array([4.0, -3.0])
    cos, sin = math.cos(turn), math.sin(turn)
    there = [
        HalfPlane((cos, sin), 1.2 + float(np.array([cos, sin]) @ shift)),
        Disc(tuple(np.array([[cos, -sin], [sin, cos]]) @ [0.9, 0.8] + shift), 0.2),  # type: ignore[arg-type]
    ]
    here, elsewhere = (resolver(drive=drive, obstacles=room) for room in (walls, there))
    q, moved = ARDIS_READY.copy(), ARDIS_READY.copy()
    moved[:3] = *shift, turn
    for k in range(150):
        twist = np.array([0.4 * math.cos(0.03 * k), 0.4 * math.sin(0.02 * k), 0.05])
        first, second = here.step(q, twist), elsewhere.step(moved, twist)
        np.testing.assert_allclose(elsewhere.chassis_velocity, here.chassis_velocity, atol=1e-7)
        np.testing.assert_allclose(second.wheels, first.wheels, atol=1e-6)  # type: ignore[arg-type]
        q, moved = q + first.value * here.dt, moved + second.value * here.dt


def test_rows_not_asked_for_are_free_and_may_be_of_any_kind() -> None:
    robot, q = resolver(robot=light(), keep_out=False), ARDIS_READY.copy()  # type: ignore[arg-type]
    for rows in (("x",), ("roll7",), ("rz", "z"), ("x", "y", "z", "rx", "ry", "rz"), ("rx", "ry", "roll7")):
        robot.reset()
        twist = 0.02 * np.arange(1, len(rows) + 1)
        command = robot.step(q, twist, rows)
        np.testing.assert_allclose(hand_twist(robot.robot, q, command.value, rows, "chassis"), twist, atol=1e-9)


def test_rows_that_are_not_in_row_sets_get_their_functions_at_rest_only() -> None:
    robot, q = resolver(row_sets=[("x", "y")]), ARDIS_READY.copy()
    for _ in range(30):
        q = q + robot.step(q, [0.1, 0.0], ("x", "y")).value * robot.dt
    command = robot.step(q, [0.1], ("rz",))
    assert command.status is Status.BRAKING
    assert command.reason == "rows rz are not in row_sets: usable once at rest"
    assert ("rz",) not in robot.row_sets
    while command.status is not Status.OK:
        q = q + command.value * robot.dt
        command = robot.step(q, [0.1], ("rz",))
    assert ("rz",) in robot.row_sets


# ------------------------------------------------------------------------------------------------- chair and arm
def test_a_lost_first_position_does_not_turn_the_chair_s_motion() -> None:
    robot = resolver(drive="differential")
    heading = 1.1
    robot.reset([0.5 * math.cos(heading), 0.5 * math.sin(heading), 0, 0, 0, 0, 0], heading=heading)
    command = robot.step(np.full(7, math.nan), [0.0, 0.0, 0.0])
    assert command.status is Status.BRAKING
    row = Differential.constraints([0, 0, heading, 0, 0, 0, 0])[0]
    assert abs(row @ command.value) < 1e-9
    assert np.hypot(*command.value[:2]) == pytest.approx(0.49, abs=1e-9)


# ------------------------------------------------------------------------------------------------------ obstacles
def test_a_chair_along_a_wall_that_it_is_within_stops_within_its_accelerations() -> None:
    """A solver leaves 1e-19 of a turn towards the wall, where nothing is left: that stopped the chair in one tick."""
    robot, q, last = resolver(drive="differential", obstacles=[HalfPlane((0, 1), 0.2)]), ARDIS_READY.copy(), np.zeros(7)
    for k in range(330):
        u = robot.step(q, np.array([0.2, -0.1, 0.0]) * (k < 300)).value
        assert np.all(np.abs(u - last) <= 0.01 * robot.robot.chain.acceleration * (1 + 1e-9))
        assert (k != 299) or np.linalg.norm(u[:2]) > 0.1
        q, last = q + 0.01 * u, u


def test_a_hand_released_beside_a_quick_limit_of_the_users_own_brakes_within_its_accelerations() -> None:
    """They braked 10 times as hard: the way to a stop was looked at in one of four places, now this, now that one.

    And its arc was taken for true, where each tick's way is straight along its beginning.
    """
    dt, rows, held, speed, angle = 0.01, "xyz", 174, 0.2436, -3.0191
    middle, radius = ca.DM([0.7531, -0.0069, 0.5177]), 0.0734
    joints = [0.4837, -0.9261, 0.0452, -0.2177, 0.5133]

    def room(chain: SerialChain, q: ca.SX) -> ca.SX:
        return radius - ca.norm_2(chain.pose_expression(q)[:3, 3] - middle + 1e-9)

    robot, names = ardis(), tuple(rows)
    made = RedundancyResolver(robot, row_sets=(names,), dt=dt, limits=[Limit(room, rate=10.0)], compile=False)
    q, last, harder = np.array([0.0, 0.0, *joints]), np.zeros(7), [0.0]
    for k in range(held + round(1.5 / dt)):
        stick = speed * np.array([math.cos(angle - q[2]), math.sin(angle - q[2]), 0.0])[: len(rows)]
        sent = made.step(q, stick, names, enable=k < held)
        if k >= held:
            harder.append(np.max(np.abs(made.chassis_velocity - last) / (robot.chain.acceleration * dt)))
            assert Relaxed.ACCELERATION not in sent.relaxed
        q, last = q + dt * sent.value, np.array(made.chassis_velocity)
    assert max(harder) <= 1 + 1e-6
    assert not last.any()


# ---------------------------------------------------------------------------------------------------------- ladder
def test_the_backup_answers_when_the_primary_is_made_to_fail() -> None:
    plain = resolver()
    with failing_solvers() as failures:
        robot = new()
    failures.primary = True
    command = robot.step(ARDIS_READY, [0.05, 0.0, 0.02])
    expected = plain.step(ARDIS_READY, [0.05, 0.0, 0.02])
    assert command.status is Status.BACKUP
    assert command.solver == "daqp"
    np.testing.assert_allclose(command.value, expected.value, atol=1e-6)
    np.testing.assert_allclose(command.wheels, expected.wheels, atol=1e-5)  # type: ignore[arg-type]


def test_where_every_solver_fails_the_whole_robot_brakes_together() -> None:
    with failing_solvers() as failures:
        robot, rng = new(keep_out=False), np.random.default_rng(11)
    chain = robot.robot.chain
    failures.every = True
    for _ in range(40):
        q, twist = posture(rng, robot.robot, 0.5), rng.standard_normal(3) * rng.choice([0.1, 1.0])
        moving = 0.2 * rng.uniform(-1, 1, 7) * chain.velocity
        robot.reset(robot.robot.world_velocity(q, moving), heading=q[2])
        command = robot.step(q, twist)
        assert command.status is Status.BACKUP
        assert command.solver == "braking together"
        hardest = np.max(np.abs(moving) / (chain.acceleration * robot.dt))  # ticks to rest
        np.testing.assert_allclose(robot.chassis_velocity, moving * max(0.0, 1 - 1 / hardest), rtol=1e-12)
        assert bool(command.relaxed & Relaxed.TASK)


def test_the_safe_command_answers_when_even_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ChairAndArm, "fallback_law", lambda self: None)
    monkeypatch.setattr(shared, "_made", {})
    with failing_solvers() as failures:
        robot, q = new(), ARDIS_READY.copy()
    for _ in range(30):
        q = q + robot.step(q, [0.2, 0.1, 0.1]).value * robot.dt
    failures.every = True
    last = robot.chassis_velocity
    command = robot.step(q, [0.2, 0.1, 0.1])
    assert command.status is Status.BRAKING
    assert "no solver" in command.reason
    assert np.all(np.abs(robot.chassis_velocity) <= np.abs(last))


@pytest.mark.usefixtures("shipped")
def test_compiled_and_interpreted_give_the_same_commands() -> None:
    """Without keep-outs, which double the compiler's time."""
    robots = [new(obstacles=[HalfPlane((1, 0), 1.5)], keep_out=False, compile=c) for c in ("wait", False)]
    q, rng, exact = ARDIS_READY.copy(), np.random.default_rng(9), 0
    for k in range(250):
        if k % 25 == 0:
            twist = rng.standard_normal(3) * 0.5
        commands = [robot.step(q, twist) for robot in robots]
        # Rounding may let one of them fall back to the other solver.
        np.testing.assert_allclose(commands[0].value, commands[1].value, rtol=0, atol=1e-7)
        exact += np.allclose(commands[0].value, commands[1].value, rtol=0, atol=1e-11)
        q = q + commands[0].value * robots[0].dt
    assert exact > 200


# ----------------------------------------------------------------------------------------------------------- reach
@pytest.mark.parametrize(("drive", "way"), [("differential", (2.0, 0.5, 0.1)), ("mecanum", (0.0, 1.5, 0.0))])
def test_a_place_is_reached_within_the_arm_s_reach_and_beyond_it(drive: str, way: tuple[float, float, float]) -> None:
    robot, q = resolver(drive=drive), ARDIS_READY.copy()
    target = robot.robot.chain.pose(q)[:3, 3] + way
    chain, last = robot.robot.chain, np.zeros(7)
    for _ in range(4000):
        command = robot.reach(q, target)
        now = robot.chassis_velocity
        assert np.all(np.abs(now - last) <= chain.acceleration * robot.dt * (1 + 1e-9) + 1e-12)
        q, last = q + command.value * robot.dt, now
        if not command.value.any():
            break
    assert np.linalg.norm(robot.robot.chain.pose(q)[:3, 3] - target) < 1e-3
    assert not command.value.any()


# ------------------------------------------------------------------------------------------------------- arguments
def test_a_start_that_breaks_a_limit_is_refused() -> None:
    robot = resolver(drive="differential")
    broken = ([0.9, 0, 0, 0, 0, 0, 0], [0, 0.1, 0, 0, 0, 0, 0], [0, 0, 0, 1.1, 0, 0, 0], [math.nan] * 7)
    refuses(robot.reset, *(((velocity,), "velocity") for velocity in broken))
    robot.reset([0.0, 0.5, 0, 0, 0, 0, 0], heading=math.pi / 2)  # that is forward
    np.testing.assert_allclose(robot.chassis_velocity, [0.5, 0, 0, 0, 0, 0, 0], atol=1e-12)


def test_arguments_that_cannot_be_used_are_named() -> None:
    settings: list[tuple[str, Any]] = [
        ("drive", "legs"), ("dt", 0.0), ("dt", 0.021), ("dt", True), ("row_sets", []), ("row_sets", [("x", "x")]),
        ("row_sets", [("x", "up")]), ("row_sets", 5), ("row_sets", "xyz"), ("max_obstacles", -1),
        ("max_obstacles", math.nan), ("max_obstacles", 10**400), ("obstacles", 5), ("obstacles", None),
        ("obstacles", Disc((1, 1), 1)), ("obstacles", [HalfPlane((0, 0), 1)]), ("obstacles", [Disc((0, 0), -1)]),
        ("self_motion", -1.0), ("self_motion", 10**400), ("self_motion", np.array([1.0, 2.0])), ("tolerance", 2.0),
        ("recovery_speed", 1.5), ("max_age", 1e-9), ("solver", "nobody"), ("keep_out", None), ("keep_out", "no"),
    ]  # fmt: skip
    refuses(new, *(({name: value}, name.removesuffix("_sets")) for name, value in settings))


def test_calls_of_the_wrong_shape_are_errors_that_name_it() -> None:
    robot = with_a_place()
    calls: list[tuple[str, Any]] = [
        ("q", np.zeros(6)), ("q", "here"), ("twist", [0.1, 0.2]), ("twist", "fast"), ("twist", None),
        ("rows", ("x", "up", "z")), ("rows", ("rx", "ry", "rz", "roll7")), ("rows", "xyz"), ("rows", None),
        ("rows", np.array(["x", "y", "z"])), ("rows", (["x"], "y", "z")), ("frame", "hand"), ("frame", []),
    ]  # fmt: skip
    for look in (robot.step, robot.instance, robot.to_qpsolvers):
        refuses(look, *(({"q": ARDIS_READY, "twist": [0.1, 0.0, 0.0], name: value}, name) for name, value in calls))
    refuses(robot.reach, *(((ARDIS_READY, it), "target") for it in ("1", ["1", "2", "3"], 5.0, [1.0, 2.0], None)))
    assert not robot.reach([10**400] * 7, [1.0, 0, 0]).status.certified


@pytest.mark.parametrize("make", [HalfPlane, Disc])
def test_an_obstacle_that_is_none_is_refused_by_its_number_and_the_last_ones_stay(make: Any) -> None:
    robot, places = with_a_place(), [
        ("a", "b"), ("1", "2"), None, 5, (1,), (1, 0, 0), {1, 2, 3}, (1j, 0), (10**400, 0), (math.nan, 1),
        (1.7e308, 1.7e308), np.array([[1.0, 0.0]]),
    ]  # fmt: skip
    sizes = [None, "1", [1], np.array([1.0, 2.0]), 1e308, 10**400, math.nan, math.inf]
    wrong = [*(make(place, 1e308) for place in places), *(make((1, 0), size) for size in sizes)]
    before = robot.obstacles
    refuses(
        lambda each: setattr(robot, "obstacles", (each,)),
        *(((each,), "obstacles[0] = ", "expected a HalfPlane") for each in wrong),
    )
    refuses(lambda: setattr(robot, "obstacles", (Disc((0, 0), 1.0),) * 3), ((), "obstacles"))
    assert robot.obstacles == before
