"""The arm of Rossa et al. hangs where math.md says, mirrors, and keeps to the participant's ranges."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import human_arm
from rehab_opt.kinematics.human_arm import ARM_JOINTS, ARM_REST
from tests.kinematics.dh_oracle import Array, chain_pose
from tests.refusals import refuses

MIRROR = np.diag([-1.0, 1.0, 1.0])
postures = st.lists(st.floats(-np.pi, np.pi), min_size=8, max_size=8).map(np.array)
ARMS = {"left": human_arm(side="left"), "right": human_arm(side="right")}
WHOLE_RANGE: Mapping[str, Sequence[float]] = dict.fromkeys(ARM_JOINTS, (-1.0, 1.0))


def test_the_arm_at_rest_hangs_by_the_length_of_its_segments() -> None:
    hand = human_arm().pose(ARM_REST)
    np.testing.assert_allclose(hand[:3, 3], [-0.13, 0.0, -0.66], atol=1e-15)
    for segments, place in (({"forearm": 0.25, "hand": 0.0}, -0.13), ([0.1, 0.2, 0.3, 0.04], -0.1)):
        hand = human_arm(segments=segments).pose(ARM_REST)
        np.testing.assert_allclose(hand[:3, 3], [place, 0.0, -0.54], atol=1e-15)


@settings(max_examples=50)
@given(postures)
def test_the_right_arm_is_the_mirror_image_of_the_left(q: Array) -> None:
    left, right = ARMS["left"], ARMS["right"]
    pose, mirrored = left.pose(q), right.pose(q)
    np.testing.assert_allclose(mirrored[:3, 3], MIRROR @ pose[:3, 3], atol=1e-12)
    np.testing.assert_allclose(mirrored[:3, 0], MIRROR @ pose[:3, 0], atol=1e-12)  # the handle
    np.testing.assert_allclose(mirrored[:3, 2], MIRROR @ pose[:3, 2], atol=1e-12)  # the fingers
    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1.0)
    jacobian = left.jacobian(q)
    np.testing.assert_allclose(right.jacobian(q)[:3], MIRROR @ jacobian[:3], atol=1e-12)
    np.testing.assert_allclose(right.jacobian(q)[3:], -MIRROR @ jacobian[3:], atol=1e-12)
    assert right.manipulability(q) == pytest.approx(left.manipulability(q), abs=1e-7)


# ----------------------------------------------------------------------------------------------- ranges of motion
def test_ranges_are_those_of_table_i() -> None:
    regular, restricted = human_arm(), human_arm(range_of_motion="restricted")
    np.testing.assert_allclose(np.rad2deg(regular.lower), [170, -20, 50, 20, 0, -50, -45, 10])
    np.testing.assert_allclose(np.rad2deg(regular.upper), [195, 10, 90, 80, 70, 60, -30, 50])
    np.testing.assert_allclose(np.rad2deg(restricted.lower), [180, 0, 70, 30, 30, 30, -30, 40])
    np.testing.assert_allclose(np.rad2deg(restricted.upper), [180, 5, 90, 70, 60, 60, -30, 45])


def test_caption_of_figure_3_is_the_regular_range_with_the_elbow_at_110_deg() -> None:
    arm = human_arm(range_of_motion="figure_3")
    np.testing.assert_allclose(np.rad2deg(arm.lower), [170, -20, 50, 20, 68, -50, -45, 10])
    np.testing.assert_allclose(np.rad2deg(arm.upper), [195, 10, 90, 80, 72, 60, -30, 50])
    q = (arm.lower + arm.upper) / 2
    shoulder, elbow, wrist = (chain_pose(arm.rows[:k], q[:k], arm.base, np.eye(4))[:3, 3] for k in (3, 4, 5))
    upper_arm, forearm = shoulder - elbow, wrist - elbow
    cosine = upper_arm @ forearm / (np.linalg.norm(upper_arm) * np.linalg.norm(forearm))
    assert np.rad2deg(np.arccos(cosine)) == pytest.approx(110.0)


def test_ranges_by_anatomical_names_count_the_scapula_from_its_rest() -> None:
    ranges = {name: (-0.1 * i, 0.2 * i) for i, name in enumerate(ARM_JOINTS, start=1)}
    arm = human_arm(range_of_motion=dict(reversed(ranges.items())))
    assert arm.names == ARM_JOINTS
    i = np.arange(1, 9)
    np.testing.assert_allclose(arm.lower, -0.1 * i + [np.pi, *[0] * 7])
    np.testing.assert_allclose(arm.upper, 0.2 * i + [np.pi, *[0] * 7])


# --------------------------------------------------------------------------------------------------- bad arguments


def test_a_bad_argument_is_named() -> None:
    masked = np.ma.array([0.13, 0.29, 0.3, 0.07], mask=[0, 1, 0, 0])
    refuses(
        human_arm,
        ({"range_of_motion": "narrow"}, "range_of_motion", "'narrow'"),
        ({"range_of_motion": {**WHOLE_RANGE, "elbow": (0.0, 1.0)}}, "range_of_motion"),
        ({"range_of_motion": {**WHOLE_RANGE, "wrist_flexion": (1.0, 0.0)}}, "range_of_motion", "(1.0, 0.0)"),
        ({"range_of_motion": {**WHOLE_RANGE, "wrist_flexion": (np.nan, 1.0)}}, "range_of_motion"),
        ({"range_of_motion": dict.fromkeys(ARM_JOINTS, ("0.1", "0.2"))}, "range_of_motion"),
        *(({"segments": each}, "segments") for each in ({"thigh": 0.4}, {"forearm": -0.3}, {"hand": np.nan}, masked)),
        ({"segments": {"hand": 70.0}}, "segments", "70.0"),
        ({"side": "both"}, "side", "'both'"),
        ({"velocity": 0.0}, "velocity"),
        *(({"acceleration": each}, "acceleration") for each in (-1.0, np.nan)),
    )
