"""Each posture cost does what the Discussion of the paper asks of it."""

import math

import numpy as np
import pytest

from rehab_opt import ConfigurationError, human_arm, ur5
from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.command import Status
from rehab_opt.control.posture import History, PostureCost, rest_posture

ARM = human_arm()


def test_many_terms_are_one_square() -> None:
    rng = np.random.default_rng(0)
    weights = {"rest": 0.3, "speed": 2.0, "elbow": 1.5, "acceleration": {"wrist_flexion": 4.0}, "displacement": 0.7}
    history = History(*(rng.uniform(ARM.lower, ARM.upper) for _ in range(3)))
    combined = PostureCost(ARM, weights).quadratic(history)
    parts = [PostureCost(ARM, {name: weight}).quadratic(history) for name, weight in weights.items()]
    for _ in range(5):
        q = rng.uniform(ARM.lower, ARM.upper)
        whole, *each = (0.5 * p.weight @ (q - p.centre) ** 2 + p.constant for p in (combined, *parts))
        assert whole == pytest.approx(sum(each))


def test_the_elbow_of_a_chain_is_found_by_name() -> None:
    robot = ur5()
    weights = PostureCost(robot, {"elbow": 1.0}).quadratic(History()).weight
    assert np.flatnonzero(weights).tolist() == [robot.names.index("elbow")]
    with pytest.raises(ConfigurationError, match="elbow"):
        PostureCost(
            ur5().with_limits().__class__(robot.rows, lower=-1, upper=1, velocity=1, acceleration=1), {"elbow": 1}
        )


def test_rest_is_inside_the_limits_even_of_an_endless_joint() -> None:
    endless = ur5(lower=-math.inf, upper=math.inf)
    np.testing.assert_array_equal(rest_posture(endless), np.zeros(6))
    answer = ArmIK(endless, handle_tilt=None, compile=False).solve([0.3, 0.2, 0.4])
    assert answer.status in (Status.OK, Status.BACKUP)
