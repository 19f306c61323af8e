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
from rehab_opt.control.manipulability import maximise_manipulability
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


def test_an_arm_that_starts_where_w_has_no_slope_comes_above_its_floor() -> None:
    """All joints of a UR5 at zero: elbow and wrist are straight."""
    robot, q = tracker(dt=5e-3), np.zeros(6)
    assert not ur5().manipulability_gradient(q).any()
    pose, before = ur5().pose(q), 0.0
    for _ in range(1000):
        q = q + 5e-3 * robot.step(q, pose, REST).value
        w = closed_form(q)
        assert w >= min(before, 0.3) - 1e-9
        before = w
    assert w >= 0.3


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
    assert robot.step(START, pose, REST).reason == "pose[0, 0] is nan, not a valid number"


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


# --------------------------------------------------------------------------------------------------- the arguments
def test_arguments_that_cannot_be_used_are_named() -> None:
    settings: list[tuple[str, object]] = [
        ("floor", 0.0), ("floor", 1.0), ("floor", math.nan), ("max_deviation", -1.0), ("linear_speed", 0.0),
        ("keep_out", (1.0,)), ("task_weights", 1.0), ("max_manipulability", 0.0), ("dt", 0.0), ("person", 3),
    ]  # fmt: skip
    refuses(tracker, *(({name: value}, name) for name, value in settings))
    robot = tracker(dt=5e-3)
    for wrong in (np.zeros((3, 3)), "pose", None, np.zeros((4, 4, 1))):
        refuses(robot.step, ((START, wrong, REST), "pose"))
        robot.step(START, ur5().pose(START), REST)
