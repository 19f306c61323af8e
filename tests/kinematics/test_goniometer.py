"""Where a goniometer says that the arm is, there the model's arm is: checked by rotations written down here."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import human_arm
from rehab_opt.kinematics.goniometer import (
    GONIOMETER,
    arm_posture,
    arm_range_of_motion,
    goniometer_angles,
    goniometer_range,
)
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from tests.refusals import refuses

RIGHT, FORWARD, UP = np.eye(3)
SEGMENTS = (0.13, 0.29, 0.30, 0.07)
Side = Literal["left", "right"]


def turned(vector: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """By Rodrigues' formula, in deg; right-handed in a frame right, forward, up."""
    a, k = math.radians(angle), axis / np.linalg.norm(axis)
    return vector * math.cos(a) + np.cross(k, vector) * math.sin(a) + k * (k @ vector) * (1 - math.cos(a))


def hand_and_thumb(side: Side, **angles: float) -> tuple[np.ndarray, np.ndarray]:
    arm = human_arm(side=side, segments=SEGMENTS)
    pose = arm.pose(arm_posture({name: math.radians(angle) for name, angle in angles.items()}))
    return pose[:3, 3], pose[:3, 0]


def anatomical(side: Side, movement: str, angle: float, elbow: float) -> tuple[np.ndarray, np.ndarray]:
    """Hand and thumb of an arm that hangs, thumb forward, elbow bent by `elbow`, then moved; in anatomical words."""
    out = -RIGHT if side == "left" else RIGHT  # lateral
    outward = 1.0 if side == "left" else -1.0  # a turn about UP that brings FORWARD to lateral
    shoulder, humerus = out.copy(), -UP
    flexed_by = elbow + (angle if movement == "elbow_flexion" else 0)
    forearm = math.sin(math.radians(flexed_by)) * FORWARD - math.cos(math.radians(flexed_by)) * UP
    thumb = math.cos(math.radians(flexed_by)) * FORWARD + math.sin(math.radians(flexed_by)) * UP
    hand = forearm.copy()
    palm_to = -out  # inwards: the thumb is forward
    match movement:
        case "forearm_pronation":  # the thumb goes over to the body's side
            thumb = math.cos(math.radians(angle)) * thumb + math.sin(math.radians(angle)) * palm_to
        case "wrist_flexion":  # towards the palm
            hand = math.cos(math.radians(angle)) * hand + math.sin(math.radians(angle)) * palm_to
        case "wrist_ulnar_deviation":  # away from the thumb
            hand, thumb = (
                math.cos(math.radians(angle)) * hand - math.sin(math.radians(angle)) * thumb,
                math.cos(math.radians(angle)) * thumb + math.sin(math.radians(angle)) * hand,
            )
    parts = [shoulder, humerus, forearm, hand, thumb]
    if movement == "shoulder_flexion":  # in the sagittal plane: what hangs comes forward
        parts[1:] = [turned(part, RIGHT, angle) for part in parts[1:]]
    elif movement == "shoulder_abduction":  # in the frontal plane: what hangs goes sideways
        parts[1:] = [turned(part, FORWARD, outward * angle) for part in parts[1:]]
    elif movement == "shoulder_external_rotation":  # about the humerus: what is forward goes sideways
        parts[1:] = [turned(part, UP, outward * angle) for part in parts[1:]]
    elif movement == "scapular_retraction":  # about the vertical: the shoulder, and all on it, goes back
        parts = [turned(part, UP, outward * angle) for part in parts]
    lengths = np.array(SEGMENTS)[:, None]
    return (lengths * np.array(parts[:4])).sum(axis=0), parts[4]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("movement", GONIOMETER)
@settings(max_examples=15, deadline=None)
@given(angle=st.floats(-90, 150), elbow=st.floats(0, 120))
def test_one_movement_at_a_time_is_exact(side: Side, movement: str, angle: float, elbow: float) -> None:
    angles = {"elbow_flexion": elbow}
    angles[movement] = angles.get(movement, 0.0) + angle
    hand, thumb = hand_and_thumb(side, **angles)
    expected_hand, expected_thumb = anatomical(side, movement, angle, elbow)
    np.testing.assert_allclose(hand, expected_hand, atol=1e-9)
    np.testing.assert_allclose(thumb, expected_thumb, atol=1e-9)


@given(st.lists(st.floats(-1.5, 1.5), min_size=8, max_size=8))
def test_postures_convert_there_and_back(values: list[float]) -> None:
    angles = dict(zip(GONIOMETER, values, strict=True))
    assert goniometer_angles(arm_posture(angles)) == pytest.approx(angles, abs=1e-12)


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1))
def test_ranges_convert_there_and_back_and_hold_the_postures_between(seed: int) -> None:
    rng = np.random.default_rng(seed)
    measured = {name: tuple(np.sort(np.deg2rad(rng.uniform(*of.range_deg, 2)))) for name, of in GONIOMETER.items()}
    ranges = arm_range_of_motion(measured)
    assert tuple(ranges) == ARM_JOINTS
    back = goniometer_range(ranges)
    for name, pair in measured.items():
        assert back[name] == pytest.approx(pair, abs=1e-12)
    arm = human_arm(range_of_motion=ranges)
    q = arm_posture({name: rng.uniform(*pair) for name, pair in measured.items()})
    assert np.all(q >= arm.lower - 1e-12)
    assert np.all(q <= arm.upper + 1e-12)
    for ends, limits in ((0, arm.lower), (1, arm.upper)):  # tight: each end of each movement is an end of its joint
        at = arm_posture(
            {name: pair[ends if GONIOMETER[name].sign > 0 else 1 - ends] for name, pair in measured.items()}
        )
        np.testing.assert_allclose(at, limits, atol=1e-12)


HEALTHY = {
    "scapular_retraction": (-15, 15), "shoulder_flexion": (-60, 180), "shoulder_abduction": (-30, 180),
    "shoulder_external_rotation": (-70, 90), "elbow_flexion": (-5, 150), "forearm_pronation": (-80, 80),
    "wrist_flexion": (-70, 80), "wrist_ulnar_deviation": (-20, 30),
}  # fmt: skip


def radians(**replaced: tuple[float, float]) -> dict[str, np.ndarray]:
    return {name: np.deg2rad(pair) for name, pair in {**HEALTHY, **replaced}.items()}


def test_names_and_shapes_are_checked() -> None:
    arm_range_of_motion(radians())
    refuses(
        lambda **replaced: arm_range_of_motion(radians(**replaced)),
        ({"elbow_flexion": (150, 0)}, "lower <= upper"),
        ({"elbow_flexion": (0, math.nan)}, "lower <= upper"),
        ({"knee_flexion": (0, 1)}, "goniometer"),
    )
    refuses(arm_range_of_motion, (({"elbow_flexion": (0, 1)},), "goniometer"))
    refuses(goniometer_range, (({"wrist_flexion": (0, 1)},), "ranges of"))
    refuses(arm_posture, (({"knee": 1.0},), "knee"), (({"elbow_flexion": math.inf},), "finite"))
    refuses(goniometer_angles, (([0.0] * 7,), "joint values"))
