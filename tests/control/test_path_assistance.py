"""Claims about assistance along a path that comes back to where it was."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from rehab_opt import Assistance, ConfigurationError, PotentialField, Relaxed, Status, Workspace
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.path_progress import INSISTS, RATHER

COMFORTABLE = Workspace(shapely.box(-0.1, -0.1, 0.3, 0.1), accuracy=0.0)
GIVEN = {"stiffness": 2000.0, "width": 0.005, "damping": 10.0}
OPTIONS = {"comfortable": COMFORTABLE, "trust_stillness": True, "compile": False, "slew_limit": 2000.0}
TURN = np.linspace(0.0, 2 * np.pi, 400)
EIGHT = np.column_stack([0.04 * np.sin(TURN), 0.02 * np.sin(2 * TURN)])
HAIRPIN = np.array([[0.0, 0.0], [0.10, 0.0], [0.10, 0.004], [0.0, 0.004]])
"""There and back, 4 mm apart: less than a width."""


def along(path: np.ndarray) -> PathAssistance:
    return PathAssistance(path, **GIVEN, **OPTIONS)  # type: ignore[arg-type]


def settled(
    helper: Assistance | PathAssistance, x: np.ndarray, ticks: int = 60, v: np.ndarray | None = None
) -> np.ndarray:
    for _ in range(ticks):
        command = helper.step(x, v)
    assert command.status is Status.OK
    return command.value


def test_on_a_straight_path_it_is_the_field_of_the_whole_path() -> None:
    path = np.column_stack([np.linspace(0.0, 0.15, 100), np.zeros(100)])
    whole = Assistance(PotentialField(path, **GIVEN, rest_on_target=False), mode="follow", **OPTIONS)  # type: ignore[arg-type]
    ours = along(path)
    for k, x in enumerate(np.linspace(0.0, 0.12, 1201)):
        hand = np.array([x, 0.0004])
        force = settled(ours, hand, 1)
        if k > 200 and k % 100 == 0:  # the field rests short of the ends
            np.testing.assert_allclose(settled(ours, hand), settled(whole, hand), atol=0.02)
    assert np.linalg.norm(force) < 1.0


def test_a_hand_moves_freely_along_the_path_and_is_damped_across_it() -> None:
    helper = along(np.array([[0.0, 0.0], [0.15, 0.0]]))
    for x in np.linspace(0.0, 0.1, 500):
        value = helper.step([x, 0.0], [0.2, 0.0]).value
    np.testing.assert_allclose(value, [0.0, 0.0], atol=0.5)  # of how far the hand went in a tick
    np.testing.assert_allclose(settled(helper, np.array([0.1, 0.0]), v=np.array([0.0, 0.2])), [0.0, -2.0], atol=1e-6)


def test_a_hand_that_goes_on_passes_every_place_of_a_crossing_path_in_order() -> None:
    helper, progress = along(EIGHT), []
    for x in np.repeat(EIGHT, 5, axis=0):
        helper.step(x + [0.0, 0.001])
        progress.append(helper.progress)
    assert np.all(np.diff(progress) >= -0.01)
    assert progress[-1] > 0.98


def test_branches_closer_than_a_width_are_told_apart() -> None:
    """The whole field rests between the branches of a hairpin; the spring on the branch that the hand has come to."""
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


def test_the_progress_never_goes_back_and_begins_anew_when_reset() -> None:
    helper, seen = along(HAIRPIN), [0.0]
    for x in np.concatenate([np.linspace(0.0, 0.08, 300), np.linspace(0.08, 0.03, 300)]):
        helper.step([x, 0.0])
        seen.append(helper.progress)
    assert np.diff(seen).min() >= 0.0
    assert helper.progress >= 0.08 / 0.204 - 0.01
    helper.reset()
    assert helper.progress == helper.reference_progress == 0.0


AHEAD_OF_A_CROSSING = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.04], [0.06, 0.04], [0.06, -0.04]])


def test_a_hand_that_is_ahead_of_its_person_goes_back_freely_before_a_crossing() -> None:
    """A push of 3 N moves it, once it outlasts a spasm, and no later branch leads it, which answers to that, too."""
    helper, goal = along(AHEAD_OF_A_CROSSING), 0.034
    for at in np.linspace(0.0, 0.06, 400):
        helper.step([at, 0.0])
    reached, x, v = helper.progress, np.array([0.06, 0.0]), np.zeros(2)
    for k in range(3000):
        push = np.clip(200.0 * (goal - x[0]), -3.0, 3.0) * np.array([1.0, 0.0])
        value = helper.step(x).value
        v = v + 1e-3 * (value + push - 15.0 * v) / 2.0
        x = x + 1e-3 * v
        assert k < 700 or np.linalg.norm(value) < 2.2
    assert abs(x[0] - goal) < 2.1 / 200.0  # up to `push`
    assert helper.progress == pytest.approx(reached, abs=0.01)
    assert helper.reference_progress < reached - 0.02 / 0.32


@pytest.mark.parametrize(("ahead", "back"), [(0.5, False), (0.3, True)])
def test_a_push_moves_s_back_where_it_answers_2_5_times_as_much_to_the_way_back(ahead: float, back: bool) -> None:
    """From a corner, straight back, which the way ahead answers to by a half, or by less than a third."""
    path = [[0.0, 0.0], [0.06, 0.0], [0.06 - 0.2 * ahead, 0.2 * math.sqrt(1 - ahead**2)]]
    helper = along(np.array(path))
    for x in np.linspace(0.0, 0.06, 300):
        helper.step([x, 0.0])
    for k in range(1000):
        helper.step([0.056, 1e-6 * (k % 2)])
    assert (helper.reference_progress < 0.0585 / 0.26) is back
    said = " ".join(str(PathAssistance.__doc__).split())
    assert f"longer than {INSISTS:g} s and answers more than {RATHER:g} times as much to the way back as to any" in said


def test_a_spasm_neither_throws_a_hand_back_nor_leads_it_on() -> None:
    helper = along(AHEAD_OF_A_CROSSING)
    for at in np.linspace(0.0, 0.06, 400):
        helper.step([at, 0.0])
    reached = helper.progress
    for k in range(1000):
        back = 0.004 * math.sin(math.pi * k / 280) if k < 280 else 0.0  # 8 N
        helper.step([0.06 - back, 1e-6 * (k % 2)])
        assert helper.reference_progress == pytest.approx(reached, abs=0.01)


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.0, 3.1])
def test_the_help_leads_no_hand_on_against_its_push(angle: float) -> None:
    """Whatever the push: s never is ahead of the hand on a straight stretch before a loop that answers to it."""
    turn = np.linspace(-math.pi / 2, 1.5 * math.pi, 200)
    loop = np.column_stack([0.06 + 0.01 * np.cos(turn), 0.01 + 0.01 * np.sin(turn)])
    helper = along(np.vstack(([[0.0, 0.0]], loop, [[0.12, 0.0]])))
    for x in np.linspace(0.0, 0.05, 300):
        helper.step([x, 0.0])
    reached = helper.progress
    off = 0.002 * np.array([math.cos(angle), math.sin(angle)])  # 4 N
    for k in range(3000):
        helper.step(np.array([0.05, 0.0]) + min(k / 100, 1.0) * off + 1e-6 * (k % 2))
    length = 0.12 + 0.02 * math.pi
    assert (helper.progress - reached) * length <= max(off[0], 0.0) + 1e-4


def test_a_push_back_along_a_path_that_does_not_return_moves_nothing_on_and_is_let_go() -> None:
    """And the hand is taken in again where it comes to a place further on, never before."""
    helper, path = along(np.array([[0.0, 0.0], [0.2, 0.0]])), np.linspace(0.0, 0.13, 520)
    for at in path:
        helper.step([at, 0.0])
    reached = helper.progress
    hand = np.array([0.13 - 6 * 0.005 - 0.006, 0.0])  # 12 N
    commands = [helper.step(hand + 1e-6 * (k % 2)) for k in range(2500)]
    assert helper.progress == pytest.approx(reached, abs=1e-3)
    held = [k for k, each in enumerate(commands) if np.linalg.norm(each.value) >= 10.0]
    assert max(held) < 2000
    assert commands[-1].status is Status.BLOCKED
    assert commands[-1].relaxed & Relaxed.TASK
    assert commands[-1].scale == 0.0
    assert "stood under force" in commands[-1].reason
    np.testing.assert_array_equal(commands[-1].value, [0.0, 0.0])
    for at in np.linspace(hand[0], 0.02, 300):
        assert helper.step([at, 0.001]).status is Status.BLOCKED
    for at in np.linspace(0.02, 0.14, 1300):
        command = helper.step([at, 0.001])
    assert command.status is Status.OK
    assert settled(helper, np.array([0.14, 0.001]))[1] == pytest.approx(-2.0, abs=0.05)


@pytest.mark.parametrize("hertz", [0.7, 1.5, 3.0])
def test_a_hand_that_trembles_along_the_path_where_it_is_held_is_let_go(hertz: float) -> None:
    """s went back and on by a width in each swing, which counted as progress, and the hand was held for good."""
    line = along(np.array([[0.0, 0.0], [0.15, 0.0]]))
    for x in np.linspace(0.0, 0.06, 600):
        line.step([x, 0.0])
    for seconds in np.arange(0.0, 4.0, line.dt):
        swing = 0.005 * math.sin(2 * math.pi * hertz * seconds) * min(seconds, 1.0)
        moved = line.step([0.06 + swing, min(0.007, 0.02 * seconds)])
        if moved.status is Status.BLOCKED:
            break
    assert moved.status is Status.BLOCKED
    assert line.progress < (0.06 + 2 * 0.005) / 0.15


@pytest.mark.parametrize("waits", range(0, 20, 2))
def test_a_crossing_takes_in_a_hand_on_the_first_of_its_branches_whenever_it_comes(waits: int) -> None:
    """At whatever place the search for it has arrived."""
    path = [[0.0, 0.0], [0.25, 0.0], [0.25, 0.08], [0.15, 0.08], [0.15, -0.2]]
    helper = PathAssistance(path, **GIVEN, **OPTIONS | {"dt": 0.01})  # type: ignore[arg-type]
    for at in np.linspace(0.0, 0.13, 52):
        helper.step([at, 0.0])
    for k in range(200):
        helper.step([0.094 + 1e-6 * (k % 2), 0.0])
    for y in np.linspace(0.0, 0.05, 30 + waits):
        assert helper.step([0.094, y]).status is Status.BLOCKED
    for x, y in np.linspace([0.094, 0.05], [0.15, 0.0], 9):
        helper.step([x, y])
    for k in range(50):
        helper.step([0.15, 1e-6 * (k % 2)])
    assert helper.progress == pytest.approx(0.15 / 0.71, abs=0.01)


def test_a_hand_that_is_where_it_was_let_go_is_not_taken_in_by_another_branch_there() -> None:
    path = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.1, 0.1], [0.1, -0.1]])
    helper = PathAssistance(path, **GIVEN, **OPTIONS | {"dt": 0.01})  # type: ignore[arg-type]
    for at in np.linspace(0.0, 0.13, 52):
        helper.step([at, 0.0])
    for k in range(300):  # let go, back from the crossing
        helper.step([0.094 + 1e-6 * (k % 2), 0.0])
    reached = helper.progress
    for at in np.linspace(0.094, 0.109, 40):
        helper.step([at, 0.0])
        assert helper.progress < reached + 0.02
    for at in np.linspace(0.109, 0.13, 40):
        helper.step([at, 0.0])
    assert helper.progress == pytest.approx(0.13 / 0.6, abs=0.01)


def test_the_help_ends_at_the_end_of_the_path() -> None:
    """The force fades within 0.3 s, and stays away wherever the hand goes."""
    helper = PathAssistance([[0.0, 0.0], [0.1, 0.0]], **GIVEN | {"stiffness": 5000.0}, **OPTIONS | {"dt": 0.02})  # type: ignore[arg-type]
    for at in np.linspace(0.0, 0.1, 100):
        helper.step([at, 0.0])
    hand = np.array([0.1 + 0.004, 0.0])  # 20 N, less than a width beyond the end
    commands = [helper.step(hand + 1e-6 * (k % 2)) for k in range(500)]
    assert helper.progress == 1.0
    commands += [helper.step([0.1 - 1e-5 * k, 0.004]) for k in range(500)]
    assert all(each.status is Status.OK for each in commands)
    assert max(np.linalg.norm(each.value) for each in commands[25:]) == 0.0
    helper.reset()
    assert helper.progress == 0.0
    assert settled(helper, np.array([0.0, 0.002]), 10)[1] == pytest.approx(-10.0)


@pytest.mark.parametrize("path", [[[0.0, 0.0], [0.1, 0.0, 0.0]], [EIGHT, EIGHT], np.stack([EIGHT, EIGHT])])
def test_what_is_not_one_path_is_refused(path: object) -> None:
    with pytest.raises(ConfigurationError, match="path"):
        along(path)  # type: ignore[arg-type]


@pytest.mark.parametrize("place", [(0.03, 0.0), (1.2, 0.3), (-300.0, 500.0)], ids=["centre", "far", "millimetres"])
def test_a_hand_that_is_not_at_the_path_covers_nothing_of_it(place: tuple[float, float]) -> None:
    """With 0.02 mm of noise a hand at the centre of a circle went round it, and one 583 m away came to the end."""
    circle = 0.03 * np.column_stack([1 - np.cos(TURN), np.sin(TURN)])
    helper, rng = along(circle), np.random.default_rng(3)
    for _ in range(3000):
        command = helper.step(place + 2e-5 * rng.standard_normal(2))
    assert helper.progress == helper.reference_progress == 0.0
    assert command.status is Status.BLOCKED


def test_a_hand_that_was_not_seen_for_a_while_is_followed_along_the_path() -> None:
    helper = along(np.array([[0.0, 0.0], [0.2, 0.0]]))
    for _ in range(50):
        helper.step((0.0, 0.0))
    for x in np.linspace(0.0, 0.08, 500):
        helper.step((math.nan, x))
    for _ in range(100):
        helper.step((0.08, 0.0))
    assert helper.progress == pytest.approx(0.4, abs=0.01)


def test_a_path_outside_the_comfortable_workspace_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"path = .*outside `comfortable`"):
        along(EIGHT + 1.0)
    assert along(EIGHT + [0.32, 0.0]).progress == 0.0  # partly


def test_a_tremor_moves_nothing_on() -> None:
    helper = along(EIGHT)
    for at in range(100):
        helper.step(EIGHT[at])
    before = helper.progress
    for k in range(2000):
        helper.step(EIGHT[100] + 4e-4 * np.array([math.cos(0.05 * k), math.sin(0.05 * k)]))  # 0.8 N
    assert (helper.progress - before) * 0.22 < 0.003


def test_changes_of_the_progress_stay_within_the_slew_bound_and_faults_move_nothing() -> None:
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
    [({"width": math.nan}, "width"), ({"width": "wide"}, "width"), ({"width": 1e-9}, "width"),
     ({"stiffness": -1.0}, "stiffness"), ({"path": [[0.0, 0.0]]}, "path"), ({"path": [[0.1, 0.0], [0.1, 0.0]]}, "path"),
     ({"path": [[0.0, math.nan], [1.0, 0.0]]}, "path"),
     ({"comfortable": None}, "comfortable"), ({"push": 0.0}, "push"), ({"damping": -1.0}, "damping")],
)  # fmt: skip
def test_bad_configuration_is_named(change: dict, named: str) -> None:
    with pytest.raises(ConfigurationError, match=named):
        PathAssistance(**{"path": HAIRPIN, **GIVEN, **OPTIONS, **change})


def test_a_path_that_is_refused_is_shown_in_short() -> None:
    with pytest.raises(ConfigurationError, match=r"(?s)^path = array.*\.\.\.: expected ") as refused:
        PathAssistance(np.full((400, 2), 1j), **GIVEN, **OPTIONS)  # type: ignore[arg-type]
    assert len(str(refused.value)) < 400
