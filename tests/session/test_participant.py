"""Whose arm it is, and where the recorded path comes to lie."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.recordings.recording import Recording
from rehab_opt.session.arm_keys import ArmSection, TableOneRange
from rehab_opt.session.participant import checked_hand, participant_arm, placed_path
from rehab_opt.session.schema import PlacementSection, RecordingSection, Side

RANGE = TableOneRange(
    scapular_retraction_deg=[0, 0],
    glenohumeral_rotation_deg=[0, 5],
    shoulder_adduction_deg=[70, 90],
    humeral_flexion_deg=[30, 70],
    forearm_extension_deg=[30, 60],
    wrist_flexion_deg=[30, 60],
    wrist_deviation_deg=[-30, -30],
    wrist_supination_deg=[40, 45],
)


def recording(points: list[list[float]]) -> Recording:
    return Recording("hand", np.arange(float(len(points))), np.array(points))


def hand(side: Side, *, mirror: bool) -> RecordingSection:
    return RecordingSection(file="x.csv", hand=side, mirror=mirror)


def test_own_range_of_motion_equal_to_table_i_gives_the_participants_arm() -> None:
    own = participant_arm(ArmSection(side="left", range_of_motion=RANGE), file="f")
    table = human_arm(range_of_motion="restricted")
    np.testing.assert_allclose(own.lower, table.lower, atol=1e-15)
    np.testing.assert_allclose(own.upper, table.upper, atol=1e-15)
    np.testing.assert_array_equal(own.locked, table.locked)


def test_other_hand_must_be_mirrored_and_the_same_one_not() -> None:
    for hand_of, mirror, expected in (("left", True, "false"), ("right", False, "true")):
        checked_hand(hand(hand_of, mirror=not mirror), side="left", file="f")  # type: ignore[arg-type]
        with pytest.raises(ProblemFileError, match=f"expected {expected}, since"):
            checked_hand(hand(hand_of, mirror=mirror), side="left", file="f")  # type: ignore[arg-type]
    point = recording([[1, 1], [1, 1]])
    with pytest.raises(ProblemFileError, match="more than one point"):
        placed_path(point, PlacementSection(centre_m=[0.0, 0.4], fit_m=[0.1, 0.1]), mirror=False, file="f")


def test_mirror_exchanges_left_and_right_after_the_turn() -> None:
    placement = PlacementSection(centre_m=[0.0, 0.4], turn_deg=90.0)
    path, sentence = placed_path(recording([[0, 0], [0, 0.2]]), placement, mirror=True, file="f")
    np.testing.assert_allclose(path, [[-0.1, 0.4, -0.24], [0.1, 0.4, -0.24]], atol=1e-15)
    assert "mirrored" in sentence


def test_height_is_projected_away_and_said() -> None:
    placement = PlacementSection(centre_m=[0.0, 0.4], plane_height_m=-0.3)
    path, sentence = placed_path(recording([[0, 0, 1.0], [0.1, 0, 1.05]]), placement, mirror=False, file="f")
    np.testing.assert_array_equal(path[:, 2], -0.3)
    assert "50 mm of height left out" in sentence


@given(
    points=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=20),
    turn=st.floats(-360, 360),
    scale=st.floats(0.1, 3),
    mirror=st.booleans(),
)
def test_placing_keeps_every_distance_up_to_the_scale(
    points: list[tuple[float, float]], turn: float, scale: float, mirror: bool
) -> None:
    placement = PlacementSection(centre_m=[-0.1, 0.4], turn_deg=turn, scale=scale)
    source = recording([list(point) for point in points])
    path, _ = placed_path(source, placement, mirror=mirror, file="f")
    before = np.linalg.norm(np.diff(source.points, axis=0), axis=1)
    after = np.linalg.norm(np.diff(path, axis=0), axis=1)
    np.testing.assert_allclose(after, scale * before, atol=1e-12)
    np.testing.assert_allclose((path.min(axis=0) + path.max(axis=0))[:2] / 2, [-0.1, 0.4], atol=1e-12)


@given(
    points=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=20),
    turn=st.floats(-360, 360),
    fit=st.tuples(st.floats(0.01, 1), st.floats(0.01, 1)),
)
def test_fitted_path_fills_its_box_and_no_more(
    points: list[tuple[float, float]], turn: float, fit: tuple[float, float]
) -> None:
    placement = PlacementSection(centre_m=[-0.1, 0.4], turn_deg=turn, fit_m=list(fit))
    source = recording([list(point) for point in points])
    if np.ptp(source.points, axis=0).max() < 1e-3:
        return
    path, _ = placed_path(source, placement, mirror=False, file="f")
    fraction = np.ptp(path, axis=0)[:2] / fit
    assert fraction.max() == pytest.approx(1.0, abs=1e-6)
