"""The chain, its frames and its inertia against poses in plain numpy and their numerical derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rehab_opt import DH, ConfigurationError, SerialChain
from rehab_opt.kinematics.ardis import ARDIS_READY, ardis
from rehab_opt.kinematics.arm_links import arm_links, arm_reach, maximise_hand_volume
from rehab_opt.kinematics.drive import Mecanum
from rehab_opt.kinematics.mobile_arm import Capsule, MobileArm, Outline
from tests.kinematics.dh_oracle import chain_pose
from tests.refusals import refuses

ROBOT = ardis(payload=1.0)
numbers = st.floats(-3, 3)
joints = st.lists(numbers, min_size=7, max_size=7).map(np.array)


def moved(q: np.ndarray, joint: int, by: float = 1e-6) -> np.ndarray:
    step = np.zeros(7)
    step[joint] = by
    return (ROBOT.chain.pose(q + step)[:3, 3] - ROBOT.chain.pose(q - step)[:3, 3]) / (2 * by)


@given(joints)
def test_the_chair_moves_the_hand_forward_left_and_about_the_vertical_of_the_world(q: np.ndarray) -> None:
    np.testing.assert_allclose(moved(q, 0), [1, 0, 0], atol=1e-8)
    np.testing.assert_allclose(moved(q, 1), [0, 1, 0], atol=1e-8)
    hand = ROBOT.chain.pose(q)[:3, 3] - [q[0], q[1], 0]
    np.testing.assert_allclose(moved(q, 2), [-hand[1], hand[0], 0], atol=1e-8)


def test_at_zero_the_upper_arm_points_up_and_the_forearm_forward_on_the_right_side() -> None:
    robot = ardis(a3=0.1, d4=0.38, d5=0.45, d7=0.5, mount_height=0.7)
    np.testing.assert_allclose(robot.chain.pose(np.zeros(7))[:3, 3], [0.1 + 0.5, -0.38, 0.7 + 0.45], atol=1e-12)
    stretched = [0, 0, 0, -np.pi / 2, 0, np.pi / 2, 0]
    np.testing.assert_allclose(robot.chain.pose(stretched)[:3, 3], [0.1 + 0.95, -0.38, 0.7], atol=1e-12)


def test_each_body_of_the_arm_lies_between_the_joints_that_carry_it() -> None:
    at_zero, points = np.zeros(7), {}
    for count in (5, 6, 7):
        points[count] = chain_pose(ROBOT.chain.rows[:count], at_zero[:count], ROBOT.chain.base, np.eye(4))
    shoulder = chain_pose(ROBOT.chain.rows[:4], at_zero[:4], ROBOT.chain.base, np.eye(4))[:3, 3]
    elbow, hand = points[5][:3, 3], points[7][:3, 3]
    for body in ROBOT.bodies:
        if body.name in {"upper arm", "forearm", "hand"}:
            begin, end = (shoulder, elbow) if body.name == "upper arm" else (elbow, hand)
            centre = (points[body.link] @ [*body.centre, 1.0])[:3]
            along = (centre - begin) @ (end - begin) / ((end - begin) @ (end - begin))
            assert 0.0 < along < 1.0
            np.testing.assert_allclose(centre, begin + along * (end - begin), atol=1e-12)


def test_largest_volume_that_the_joints_span_is_that_of_upper_arm_and_forearm_across_each_other() -> None:
    robot = ardis(d5=0.3, d7=0.4)
    free = robot.chain.with_limits(lower=-np.pi, upper=np.pi)
    assert maximise_hand_volume(free, first=3) == pytest.approx(0.3 * 0.4**2, rel=1e-6)


@pytest.mark.parametrize("offset", [0.0, 0.35])
def test_no_tool_is_further_from_an_axis_of_the_arm_than_its_reach(offset: float) -> None:
    rows = [DH(0.0, -np.pi / 2, 0.0, prismatic=True), DH(0.0, np.pi / 2), DH(0.2, np.pi / 2), DH(0.1, -1.0, 0.3)]
    tool = np.eye(4)
    tool[0, 3] = offset
    chain = SerialChain(rows, lower=-3.0, upper=3.0, velocity=1.0, acceleration=1.0, tool=tool)
    reach = arm_reach(chain, arm_links(chain, first=2, radius=0.05), first=2)
    furthest = 0.0
    for q in np.random.default_rng(2).uniform(-3, 3, (2000, 4)):
        axis, hand = chain_pose(rows[:2], q[:2], np.eye(4), np.eye(4)), chain.pose(q)[:3, 3]
        furthest = max(furthest, float(np.linalg.norm(np.cross(axis[:3, 2], hand - axis[:3, 3]))))
    assert 0.7 * reach < furthest <= reach


def kinetic_energy(robot: MobileArm, q: np.ndarray, velocity: np.ndarray, h: float = 1e-6) -> float:
    """From link poses a moment before and after, told by matrices alone."""
    rows, total = robot.chain.rows, float(robot.rotors @ velocity**2) / 2
    for body in robot.bodies:
        ahead, now, behind = (
            chain_pose(rows[: body.link], (q + t * velocity)[: body.link], robot.chain.base, np.eye(4))
            for t in (h, 0.0, -h)
        )
        speed = (ahead - behind) @ np.append(body.centre, 1.0) / (2 * h)
        spin = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec() / (2 * h)
        inertia = now[:3, :3] @ body.inertia @ now[:3, :3].T
        total += (body.mass * speed[:3] @ speed[:3] + spin @ inertia @ spin) / 2
    return total


@given(joints, joints)
def test_inertia_gives_the_kinetic_energy_of_the_moving_links(q: np.ndarray, velocity: np.ndarray) -> None:
    expected = kinetic_energy(ROBOT, q, velocity)
    assert velocity @ ROBOT.inertia(q) @ velocity / 2 == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(joints, joints)
def test_energy_in_chassis_velocities_does_not_know_the_heading(q: np.ndarray, velocity: np.ndarray) -> None:
    still = np.array([0, 0, 0, *q[3:]])
    turned = ROBOT.world_velocity(q, velocity)
    assert turned @ ROBOT.inertia(q) @ turned == pytest.approx(velocity @ ROBOT.inertia(still) @ velocity, rel=1e-9)
    np.testing.assert_allclose(ROBOT.chassis_velocity(q, ROBOT.world_velocity(q, velocity)), velocity, atol=1e-12)


@given(joints)
def test_posture_gradient_is_the_derivative_of_the_posture_cost_and_leaves_the_chair_alone(q: np.ndarray) -> None:
    gradient, h = ROBOT.posture_gradient(q), 1e-6
    for i in range(7):
        step = h * np.eye(7)[i]
        slope = (ROBOT.posture_cost(q + step) - ROBOT.posture_cost(q - step)) / (2 * h)
        assert gradient[i] == pytest.approx(slope, abs=1e-6)
    assert not gradient[:3].any()


def test_posture_costs_more_at_limits_and_where_the_arm_is_stretched() -> None:
    free = ardis(limit_cost=0.0)
    for elbow in (-1.2, 0.8, 1.4):
        q = ARDIS_READY.copy()
        q[5] = elbow
        assert free.posture_cost(q) > free.posture_cost(ARDIS_READY)
    q = ARDIS_READY.copy()
    q[6] = ROBOT.chain.upper[6]
    assert ROBOT.posture_cost(q) > ROBOT.posture_cost(ARDIS_READY) + 0.2


def test_a_robot_that_cannot_be_is_refused() -> None:
    hostile = (None, "a", np.nan, np.inf, -1.0, [1, 2], True, np.timedelta64(1, "s"))
    refuses(
        ardis,
        ({"velocity": (0.8, 0.7, 1, 1, 1, 1, 1)}, "velocity"),
        ({"lower": (0, -np.inf, -np.inf, -1, -1, -1, -1)}, "lower"),
        ({"upper": (np.inf, np.inf, np.inf, np.inf, 1, 1, 1)}, "upper"),
        ({"d5": 0.0}, "d5"),
        ({"chair_mass": np.nan}, "chair_mass"),
        ({"rotors": (0, 0, 0, np.nan, 1, 1, 1)}, "rotors"),
        ({"limit_cost": -1.0}, "limit_cost"),
        *(({mass: bad}, mass) for mass in ("shoulder_mass", "payload", "chair_turn_inertia") for bad in hostile),
        ({"differential": Mecanum(radius=0.1, half_gauge=0.2, half_base=0.2, limit=5.0)}, "differential"),
        ({"outline": Outline(1.0, 0.0, 0.0, 1.0)}, "outline"),
        *(({"keep_out": [Capsule("user", (0, 0, 0), (0, 0, 1), bad)]}, "keep_out") for bad in hostile),
    )


def test_an_arm_with_a_joint_too_few_is_no_mobile_arm() -> None:
    chain = ROBOT.chain
    limits = {name: getattr(chain, name)[:-1] for name in ("lower", "upper", "velocity", "acceleration")}
    with pytest.raises(ConfigurationError, match=r"chain.*two joints that slide, and 5 or more that turn"):
        replace(ROBOT, chain=SerialChain(chain.rows[:-1], **limits))
