"""Each posture cost does what the Discussion of the paper asks of it."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import ConfigurationError, human_arm, ur5
from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.command import Status
from rehab_opt.control.posture import History, PostureCost, rest_posture
from rehab_opt.kinematics.human_arm import ARM_JOINTS, ARM_REST

Array = NDArray[np.float64]
ARM = human_arm()
TARGET = np.array([-0.15, 0.45, -0.24])
ELBOW = ARM_JOINTS.index("forearm_extension")


def solved(cost: dict[str, object], **options: object) -> Array:
    answer = ArmIK(ARM, posture_cost=cost, compile=False, **options).solve(TARGET)  # type: ignore[arg-type]
    assert answer.status.certified
    return answer.q


def path(count: int = 60) -> Array:
    fraction = np.linspace(0, 1, count)[:, None]
    return TARGET + fraction * [0.05, -0.05, 0.0]


def test_rest_is_the_range_normalised_distance() -> None:
    answer = ArmIK(ARM, compile=False).solve(TARGET)
    rest = np.clip(ARM_REST, ARM.lower, ARM.upper)
    expected = 0.5 * np.sum(((answer.q - rest) / (ARM.upper - ARM.lower)) ** 2)
    assert answer.cost == pytest.approx(expected)


def test_a_chosen_joint_moves_less() -> None:
    plain = ArmIK(ARM, compile=False).follow(path())
    chosen = ArmIK(ARM, posture_cost={"rest": 0.01, "displacement": {"humeral_flexion": 50.0}}, compile=False)
    held = chosen.follow(path(), start=plain.q[0])
    joint = ARM_JOINTS.index("humeral_flexion")
    assert np.ptp(held.q[:, joint]) < np.ptp(plain.q[:, joint])


def test_terms_of_change_count_from_when_there_is_something_to_change() -> None:
    cost = PostureCost(ARM, {"speed": 1.0, "acceleration": 1.0, "displacement": 1.0})
    nothing = cost.quadratic(History())
    np.testing.assert_allclose(nothing.centre, rest_posture(ARM))  # where nothing is left, rest decides
    q = (ARM.lower + ARM.upper) / 2
    np.testing.assert_allclose(cost.quadratic(History(previous=q, origin=q)).centre, q)


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
