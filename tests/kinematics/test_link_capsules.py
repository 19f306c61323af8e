"""Bodies of links: what is accepted, and what stands for them before a plane."""

import math
from typing import Any

import numpy as np
import pytest

from rehab_opt import ConfigurationError, LinkCapsule, human_arm, ur5
from rehab_opt.control.hand_bounds import guarded_points
from rehab_opt.kinematics.human_arm import ARM_REST
from rehab_opt.kinematics.room import arm_capsules
from rehab_opt.kinematics.ur5 import UR5_CAPSULES
from tests.refusals import refuses

GOOD = LinkCapsule("hand", 7, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 0.05)


def test_a_capsule_that_is_none_is_refused_by_name() -> None:
    changes: list[dict[str, Any]] = [
        {"frame": 8}, {"frame": -1}, {"frame": 1.0}, {"radius": -0.01}, {"radius": math.nan}, {"start": (0.0, 0.0)},
        {"end": (0.0, math.inf, 0.0)}, {"name": 3}, {"end": None},
    ]  # fmt: skip
    wrong = ([*UR5_CAPSULES, GOOD._replace(**changed)] for changed in changes)
    refuses(ur5, *(({"capsules": capsules}, "capsules[7]") for capsules in wrong))


def test_balls_within_others_and_those_that_rest_are_left_out() -> None:
    frames = [(ball.frame, ball.radius) for ball in guarded_points(ur5())]
    assert frames == [(5, 0.066), (5, 0.066), (4, 0.066), (3, 0.066), (2, 0.073), (2, 0.073), (1, 0.073)]
    tool = np.eye(4)
    tool[2, 3] = 0.15
    assert guarded_points(ur5(tool=tool))[0] == (7, (0.0, 0.0, 0.0), 0.0)
    assert guarded_points(ur5(capsules=[*UR5_CAPSULES, GOOD]))[:2] == ((7, GOOD.start, 0.05), (7, GOOD.end, 0.05))


@pytest.mark.parametrize("side", ["left", "right"])
def test_arm_of_a_person_is_where_its_joints_are_and_moves_as_they_do(side: Any) -> None:
    arm, rng = human_arm(side=side), np.random.default_rng(0)
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], (0.5, 0.2, 0.3)
    q, velocity, step = ARM_REST + rng.uniform(-0.3, 0.3, 8), rng.normal(size=8), 1e-6
    upper, fore, hand = arm_capsules(arm, q, velocity, placement=placement)
    assert np.linalg.norm(np.subtract(upper.end, upper.start)) == pytest.approx(0.29)
    assert np.linalg.norm(np.subtract(fore.end, fore.start)) == pytest.approx(0.30)
    np.testing.assert_allclose(hand.end, (placement @ arm.pose(q))[:3, 3], atol=1e-12)
    np.testing.assert_allclose(upper.end, fore.start)
    later = arm_capsules(arm, q + step * velocity, placement=placement)
    for now, then in zip((upper, fore, hand), later, strict=True):
        np.testing.assert_allclose(np.subtract(then.start, now.start) / step, now.start_velocity, atol=1e-4)
        np.testing.assert_allclose(np.subtract(then.end, now.end) / step, now.end_velocity, atol=1e-4)
    with pytest.raises(ConfigurationError, match="arm"):
        arm_capsules(ur5(), q[:6], placement=placement)
