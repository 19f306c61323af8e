"""Claims about assistance along a path that comes back to where it was."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from rehab_opt import Assistance, ConfigurationError, PotentialField, Status, Workspace
from rehab_opt.control.path_assistance import PathAssistance

COMFORTABLE = Workspace(shapely.box(-0.1, -0.1, 0.3, 0.1), accuracy=0.0)
GIVEN = {"stiffness": 2000.0, "width": 0.005, "damping": 10.0}
OPTIONS = {"comfortable": COMFORTABLE, "trust_stillness": True, "compile": False, "slew_limit": 2000.0}
TURN = np.linspace(0.0, 2 * np.pi, 400)
EIGHT = np.column_stack([0.04 * np.sin(TURN), 0.02 * np.sin(2 * TURN)])
HAIRPIN = np.array([[0.0, 0.0], [0.10, 0.0], [0.10, 0.004], [0.0, 0.004]])
"""There and back, 4 mm apart: less than a width."""


def along(path: np.ndarray) -> PathAssistance:
    return PathAssistance(path, **GIVEN, **OPTIONS)  # type: ignore[arg-type]


def settled(helper: Assistance, x: np.ndarray, ticks: int = 60) -> np.ndarray:
    for _ in range(ticks):
        command = helper.step(x)
    assert command.status is Status.OK
    return command.value


def test_on_a_simple_path_it_is_the_field_of_the_whole_path() -> None:
    path = np.column_stack([np.linspace(0.0, 0.15, 100), np.zeros(100)])
    whole = Assistance(PotentialField(path, **GIVEN, rest_on_target=False), mode="follow", **OPTIONS)  # type: ignore[arg-type]
    piecewise = along(path)
    for x in np.linspace(0.0, 0.15, 16):
        hand = np.array([x, 0.004])
        np.testing.assert_allclose(settled(piecewise, hand), settled(whole, hand), atol=0.02)


def test_a_hand_that_goes_on_passes_every_place_of_a_crossing_path_in_order() -> None:
    helper, progress = along(EIGHT), []
    for x in np.repeat(EIGHT, 5, axis=0):
        helper.step(x + [0.0, 0.001])
        progress.append(helper.progress)
    assert np.all(np.diff(progress) >= -0.01)
    assert progress[-1] > 0.98


def test_branches_closer_than_a_width_are_told_apart() -> None:
    """The whole field rests between the branches of a hairpin; the piece rests on the branch the hand is on."""
    hand = np.array([0.05, 0.0])
    whole = Assistance(PotentialField(HAIRPIN, **GIVEN, rest_on_target=False), mode="follow", **OPTIONS)  # type: ignore[arg-type]
    helper = along(HAIRPIN)
    for x in np.linspace(0.0, 0.05, 200):
        helper.step([x, 0.0])
    assert abs(settled(whole, hand)[1]) > 2.0
    assert abs(settled(helper, hand)[1]) < 0.05
    for x in [*np.column_stack([np.linspace(0.05, 0.10, 200), np.zeros(200)]), [0.10, 0.002], [0.10, 0.004],
              *np.column_stack([np.linspace(0.10, 0.05, 200), np.full(200, 0.004)])]:  # fmt: skip
        helper.step(x)
    assert abs(settled(helper, np.array([0.05, 0.004]))[1]) < 0.05
    assert helper.progress == pytest.approx((0.10 + 0.004 + 0.05) / 0.204, abs=0.02)


def test_it_goes_backwards_with_the_hand_and_begins_anew_when_reset() -> None:
    helper = along(HAIRPIN)
    for x in np.concatenate([np.linspace(0.0, 0.08, 300), np.linspace(0.08, 0.03, 300)]):
        helper.step([x, 0.0])
    assert helper.progress == pytest.approx(0.03 / 0.204, abs=0.02)
    helper.reset()
    assert helper.progress == 0.0


def test_changes_from_piece_to_piece_stay_within_the_slew_bound_and_faults_move_nothing() -> None:
    helper, last = along(EIGHT), np.zeros(2)
    rng = np.random.default_rng(0)
    hand = EIGHT[0].copy()
    for k in range(3000):
        hand = hand + 2e-4 * rng.standard_normal(2) + 0.05 * (EIGHT[(k // 8) % 400] - hand)
        before = helper.progress
        lost = k % 97 == 0
        value = helper.step([math.nan, 0.0] if lost else hand).value
        assert not lost or helper.progress == before
        assert np.isfinite(value).all()
        assert math.hypot(*value) <= 30.0
        assert math.hypot(*(value - last)) <= 2000.0 * 1e-3 * (1 + 1e-9)
        last = value


@pytest.mark.parametrize(
    ("change", "named"),
    [({"width": math.nan}, "width"), ({"width": "wide"}, "width"), ({"stiffness": -1.0}, "stiffness"),
     ({"path": [[0.0, 0.0]]}, "path"), ({"path": [[0.1, 0.0], [0.1, 0.0]]}, "path"),
     ({"path": [[0.0, math.nan], [1.0, 0.0]]}, "path"),
     ({"comfortable": None}, "comfortable")],
)  # fmt: skip
def test_bad_configuration_is_named(change: dict, named: str) -> None:
    with pytest.raises(ConfigurationError, match=named):
        PathAssistance(**{"path": HAIRPIN, **GIVEN, **OPTIONS, **change})
