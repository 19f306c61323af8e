"""Clinical angles and model joints describe one arm: scipy's rotations on one side, the chain on the other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rehab_opt import human_arm
from rehab_opt.workspace.clinical_angles import (
    isb_shoulder,
    isb_wrist,
    model_scapula,
    model_shoulder,
    model_wrist,
)

ARM = human_arm()
RIGHT = np.eye(3)[0]
LEFT = -RIGHT


# ----------------------------------------------------------------------------------------------------- the conversion
angle = st.floats(-3.0, 3.0)


@given(angle, st.floats(0.01, 3.0), angle, st.floats(0.0, 2.6), angle, st.floats(-1.4, 1.4), st.floats(-0.7, 0.7))
def test_the_model_stands_as_the_clinical_angles_say(
    plane: float, elevation: float, axial: float, elbow: float, pronation: float, flexion: float, ulnar: float
) -> None:
    """ISB orders: plane, elevation, axial rotation; elbow; pronation, flexion, deviation, each about the moved axes.

    For a left arm in a frame right, forward, up; the arm hangs along -z with the palm forward where all are zero.
    """
    humerus = Rotation.from_euler("ZYZ", [-plane, elevation, -axial])
    forearm = humerus * Rotation.from_euler("X", elbow)
    hand = forearm * Rotation.from_euler("ZXY", [-pronation, flexion, -ulnar])
    down = np.array([0.0, 0.0, -1.0])
    position = 0.13 * LEFT + humerus.apply(0.29 * down) + forearm.apply(0.30 * down) + hand.apply(0.07 * down)
    q = [np.pi, *model_shoulder(plane, elevation, axial), elbow, *model_wrist(pronation, flexion, ulnar)]
    pose = ARM.pose(np.array(q, dtype=float))
    np.testing.assert_allclose(pose[:3, 3], position, atol=1e-7)
    np.testing.assert_allclose(pose[:3, 0], hand.apply(LEFT), atol=1e-7)
    np.testing.assert_allclose(pose[:3, 2], hand.apply(down), atol=1e-7)


def test_the_scapula_is_counted_from_the_start_and_backwards() -> None:
    np.testing.assert_allclose(model_scapula([[0.5, 0.7, 0.6], [0.1, 0.0, 0.1]]), [[0, -0.2, -0.1], [0, 0.1, 0]])


@given(st.floats(-3.1, 3.1), st.floats(0.02, 3.1), st.floats(-3.1, 3.1))
def test_shoulder_converts_there_and_back(plane: float, elevation: float, axial: float) -> None:
    joints = model_shoulder(plane, elevation, axial)
    back = model_shoulder(*isb_shoulder(*joints))
    turns = [Rotation.from_euler("ZYX", [q2, np.pi / 2 - q3, q4]) for q2, q3, q4 in (joints, back)]
    assert (turns[0].inv() * turns[1]).magnitude() < 1e-6
    seen = Rotation.from_euler("ZYZ", [-isb_shoulder(*joints)[0], isb_shoulder(*joints)[1], -isb_shoulder(*joints)[2]])
    assert (seen.inv() * turns[0]).magnitude() < 1e-6


@given(angle, st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_wrist_converts_there_and_back(pronation: float, flexion: float, ulnar: float) -> None:
    back = isb_wrist(*model_wrist(pronation, flexion, ulnar))
    np.testing.assert_allclose(np.array(back, dtype=float), [pronation, flexion, ulnar], atol=1e-6)
