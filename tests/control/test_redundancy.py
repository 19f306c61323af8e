"""Claims about RedundancyResolver that a user's safety rests on, judged by plain numpy."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from rehab_opt import RedundancyResolver, Relaxed, Status, ardis
from rehab_opt.control.chair_and_arm import ChairAndArm
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.kinematics.drive import Differential
from rehab_opt.kinematics.mobile_arm import MobileArm
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.symbolic import shared
from tests.failing_solvers import failing_solvers
from tests.refusals import refuses

DRIVES = ("mecanum", "differential")


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


def posture(rng: np.random.Generator, robot: MobileArm, fraction: float = 1.0) -> np.ndarray:
    middle = (robot.chain.lower[3:] + robot.chain.upper[3:]) / 2
    half = fraction * (robot.chain.upper[3:] - robot.chain.lower[3:]) / 2
    return np.concatenate([rng.uniform(-3, 3, 3), middle + half * rng.uniform(-1, 1, 4)])


# ----------------------------------------------------------------------------------------------- speed and direction


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


# --------------------------------------------------------------------------------------------------- zero commands


def with_a_place() -> RedundancyResolver:
    return resolver(max_obstacles=1, keep_out=False)


# ------------------------------------------------------------------------------------------------ rows and frames


def test_rows_that_are_not_in_row_sets_get_their_functions_at_rest_only() -> None:
    robot, q = resolver(row_sets=[("x", "y")]), ARDIS_READY.copy()
    for _ in range(30):
        q = q + robot.step(q, [0.1, 0.0], ("x", "y")).value * robot.dt
    command = robot.step(q, [0.1], ("rz",))
    assert command.status is Status.BRAKING
    assert command.reason == "rows rz are not in row_sets: allowed once at rest"
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


# ------------------------------------------------------------------------------------------------------- fallback
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
