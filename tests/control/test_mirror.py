"""Claims about MirrorTracker that a person's safety rests on, judged by plain numpy and the UR5's closed form."""

import functools
import math

import numpy as np
import pytest
from hypothesis import strategies as st

from rehab_opt import (
    MirrorTracker,
    Status,
    human_arm,
    ur5,
)
from rehab_opt.control.manipulability import drawn_ways, escape_function, maximise_manipulability
from rehab_opt.symbolic import BufferedFunction
from tests.control.mirror_campaign import LARGEST, Array, closed_form
from tests.failing_solvers import failing_solvers
from tests.refusals import refuses

START = np.array([3.2, -1.5, 1.9, -2.0, -1.4, 0.2])
REST = np.zeros(6)


@functools.cache
def made(options: tuple[tuple[str, object], ...]) -> MirrorTracker:
    return MirrorTracker(ur5(), **{"max_manipulability": LARGEST, "compile": False, **dict(options)})  # type: ignore[arg-type]


def tracker(**options: object) -> MirrorTracker:
    """A fresh one; building it takes longer than most tests."""
    robot = made(tuple(sorted(options.items())))
    robot.reset()
    return robot


def moved(pose: Array, *shift: float) -> Array:
    found = pose.copy()
    found[:3, 3] += shift
    return found


# ----------------------------------------------------------------------------------------------------- the floor


def test_drawn_ways_are_those_of_splitmix() -> None:
    """The first numbers of seed 1234567, as its author publishes them."""
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    numbers = [(each >> 11) * 2.0**-52 - 1.0 for each in published]
    np.testing.assert_array_equal(drawn_ways(2, 2, seed=1234567).ravel(), numbers)
    many = drawn_ways(4000, 3, seed=0)
    assert np.abs(many).max() < 1.0
    assert np.abs(many.mean(axis=0)).max() < 0.05


def test_a_way_out_is_deterministic_and_gains() -> None:
    chain = ur5()
    first, again = (BufferedFunction(escape_function(chain)).of(np.zeros(6), 0) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert not chain.manipulability_gradient(np.zeros(6)).any()
    assert closed_form(0.4 * first) > 1e-3
    robot, still = tracker(), np.zeros(6)
    robot.step(still, chain.pose(still), REST)  # finds it
    assert robot.step(still, chain.pose(still), REST).value @ first > 1e-3


def test_the_largest_manipulability_of_the_ur5_is_the_closed_forms() -> None:
    largest, q = maximise_manipulability(ur5())
    assert largest == pytest.approx(LARGEST, abs=1e-9)
    assert closed_form(q) == pytest.approx(1.0, abs=1e-7)
    arm, posture = maximise_manipulability(human_arm())  # any chain: nothing near it is better
    assert arm > 0.09
    assert np.all((posture >= human_arm().lower - 1e-12) & (posture <= human_arm().upper + 1e-12))


# -------------------------------------------------------------------------------------------------- what goes wrong
def test_a_pose_ten_times_farther_than_the_arm_reaches_is_a_mistake_and_one_nearer_is_not() -> None:
    """Millimetres were bridged, at 0.12 m/s for an hour."""
    chain, at = ur5(base=np.array([[0, -1, 0, 5.0], [1, 0, 0, 2.0], [0, 0, 1, 0], [0, 0, 0, 1]])), []
    robot = MirrorTracker(chain, dt=0.01, max_manipulability=0.1, compile=False)
    straight = 0.425 + 0.39225 + 0.09465 + 0.10915 + 0.0823 + 0.089159
    assert robot.farthest == pytest.approx(10 * straight)
    for away in (0.999, 1.001):
        robot.reset()
        pose = chain.pose(START)
        for k in range(3):
            if k:
                pose[:3, 3] = [5.0, 2.0 + away * robot.farthest, 0.0]
            command = robot.step(START, pose, REST)
        at.append(command)
    assert "bridging a jump" in at[0].reason
    assert at[1].reason == "pose is farther than ten times the arm's reach: is it in metres?"
    assert not at[1].status.certified
    robot.step(START, np.full((4, 4), np.nan), REST)
    pose[0, 0] = np.nan
    assert robot.step(START, pose, REST).reason == "pose[0, 0] is nan, not a usable number"


numbers = st.floats(allow_nan=True, allow_infinity=True, width=64)


def test_the_backup_answers_under_the_same_bounds() -> None:
    with failing_solvers() as failures:
        robot, q = MirrorTracker(ur5(), dt=5e-3, max_manipulability=LARGEST, compile=False), START.copy()
    pose = moved(ur5().pose(START), 0.05, 0, 0)
    failures.primary = True
    for _ in range(40):
        command = robot.step(q, pose, [0.2, 0, 0, 0, 0, 0])
        assert command.status is Status.BACKUP
        q = q + command.value * 5e-3
        assert closed_form(q) >= 0.3
    failures.every = True
    command = robot.step(q, pose, REST)
    assert command.status is Status.BRAKING
    assert command.reason.startswith("no solver gave a certified answer")


# ---------------------------------------------------------------------------------------------------- the statement
def test_the_qp_can_be_inspected_and_its_floor_row_is_the_gradient() -> None:
    robot = tracker()
    numbers = robot.instance(START, ur5().pose(START), REST)
    assert numbers.A.shape == (2, 7)
    h = 1e-6
    gradient = [(closed_form(START + h * e) - closed_form(START - h * e)) / (2 * h) for e in np.eye(6)]
    np.testing.assert_allclose(numbers.A[0, :6], -np.array(gradient), atol=1e-6)
    fraction = (1 - math.exp(-20 * 1e-3)) / 1e-3
    assert numbers.rows_upper[0] == pytest.approx(fraction * (closed_form(START) - 0.3), rel=1e-3)


def test_arguments_that_cannot_be_used_are_named() -> None:
    settings: list[tuple[str, object]] = [
        ("floor", 0.0), ("floor", 1.0), ("floor", math.nan), ("max_deviation", -1.0), ("linear_speed", 0.0),
        ("keep_out", (1.0,)), ("task_weights", 1.0), ("max_manipulability", 0.0), ("dt", 0.0), ("rate", math.nan),
        ("person", 3),
    ]  # fmt: skip
    refuses(tracker, *(({name: value}, name) for name, value in settings))
    robot = tracker(dt=5e-3)
    for wrong in (np.zeros((3, 3)), "pose", None, np.zeros((4, 4, 1))):
        refuses(robot.step, ((START, wrong, REST), "pose"))
        robot.step(START, ur5().pose(START), REST)
