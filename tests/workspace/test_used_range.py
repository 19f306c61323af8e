"""The range used is what numpy's percentiles say of the samples seen, and says what it does not know."""

import numpy as np
import pytest

from rehab_opt import ConfigurationError, human_arm
from rehab_opt.workspace.used_range import named_ranges, range_of_motion
from tests.refusals import refuses

RNG = np.random.default_rng(3)
SWING = 0.6 * np.sin(np.linspace(0.0, 9.0, 400)) + 0.05 * RNG.standard_normal(400)


# ------------------------------------------------------------------------------------------------------- the numbers
def test_a_range_is_the_percentiles_of_all_trials_together() -> None:
    trials = [SWING[:100], SWING[100:130], SWING[130:]]
    used = range_of_motion({"elbow": trials}, lower_percentile=2.5, upper_percentile=90)
    np.testing.assert_allclose(used["elbow"], np.percentile(SWING, [2.5, 90]))
    assert (used.samples["elbow"], used.trials["elbow"], used.gaps["elbow"]) == (400, 3, 0)


def test_gaps_are_counted_and_change_nothing() -> None:
    holed = np.insert(SWING, [3, 90, 399], [np.nan, np.nan, np.inf])
    used = range_of_motion({"elbow": [holed, np.full(5, np.nan)]})
    np.testing.assert_allclose(used["elbow"], np.percentile(SWING, [5, 95]))
    assert (used.samples["elbow"], used.trials["elbow"], used.gaps["elbow"]) == (400, 1, 8)
    assert "8 of 408" in used.notes[0]


def test_masked_samples_are_gaps_whatever_stands_under_the_mask() -> None:
    holed = np.insert(SWING, [3, 90, 399], [9.0, -9.0, 1e9])
    used = range_of_motion({"elbow": np.ma.masked_array(holed, ~np.isin(holed, SWING))})
    np.testing.assert_allclose(used["elbow"], np.percentile(SWING, [5, 95]))
    assert used.gaps["elbow"] == 3
    eight = np.ma.masked_array(np.tile(holed[:, None], 8), np.tile(~np.isin(holed, SWING)[:, None], 8))
    assert range_of_motion(eight)["wrist_flexion"] == used["elbow"]


def test_small_angles_in_degrees_are_told_by_their_width() -> None:
    with pytest.raises(ConfigurationError, match="degrees"):
        range_of_motion({"wrist_flexion": np.linspace(2.0, 10.0, 300)})


def test_jumps_by_whole_turns_are_undone_within_and_between_trials() -> None:
    around = 3.0 + SWING  # crosses pi
    jumping = np.angle(np.exp(1j * around))
    assert np.ptp(jumping) > 6
    expected = np.percentile(around, [5, 95])
    np.testing.assert_allclose(range_of_motion({"wrist": jumping})["wrist"], expected)
    trials = [around[:200], around[200:] - 2 * np.pi]
    np.testing.assert_allclose(range_of_motion({"wrist": trials})["wrist"], expected)
    near = range_of_motion({"wrist": around}, within={"wrist": (-2 * np.pi, 0.0)})  # the branch of the limits
    np.testing.assert_allclose(near["wrist"], expected - 2 * np.pi)


def test_joints_without_data_stay_away() -> None:
    seen = range_of_motion({"humeral_flexion": SWING, "forearm_extension": 0.5 + SWING})
    assert tuple(seen) == ("humeral_flexion", "forearm_extension")
    with pytest.raises(ConfigurationError, match="wrist_flexion"):
        human_arm(range_of_motion=seen)
    human_arm(range_of_motion={**named_ranges("", "regular"), **seen})


# ------------------------------------------------------------------------------------------------------ bad arguments
def test_what_cannot_be_a_recording_is_refused() -> None:
    refuses(
        range_of_motion,
        (({"a": np.full(50, np.nan)},), "a"),
        ({"angles": {"a": SWING}, "minimum_samples": 401}, "401"),
        (({"a": np.rad2deg(SWING)},), "degrees"),
        ({"angles": {"a": SWING}, "lower_percentile": 95, "upper_percentile": 5}, "percentile"),
        ({"angles": {"a": SWING}, "margin": -0.1}, "margin"),
        ({"angles": {"a": SWING}, "within": {"b": (0, 1)}}, "within"),
        ({"angles": {"a": SWING}, "within": {"a": (1, 0)}}, "within"),
        ({"angles": np.zeros((50, 8)), "names": "abcdefgh"}, "names"),
        (({"a": "text"},), "a"),
        (({},), "angles"),
        ((np.zeros((50, 3)),), "names"),
        ({"angles": np.zeros((50, 3)), "names": ["a", "b", "b"]}, "names"),
        ({"angles": [np.zeros((50, 2)), np.zeros((50, 3))], "names": ["a", "b"]}, "angles"),
        ((np.full((50, 8), np.pi),), "angles"),  # joint 1 as the chain counts it, not from its rest
    )
