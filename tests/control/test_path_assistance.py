"""Claims about assistance along a path that comes back to where it was."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import ArrayLike

from rehab_opt import Assistance, Command, PotentialField, Relaxed, Status, Workspace
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.path_progress import PATH_MODEL
from tests.refusals import refuses

COMFORTABLE = Workspace(shapely.box(-0.1, -0.1, 0.3, 0.1), accuracy=0.0)
GIVEN = {"stiffness": 2000.0, "width": 0.005, "damping": 10.0}
OPTIONS = {"comfortable": COMFORTABLE, "trust_stillness": True, "compile": False, "slew_limit": 2000.0}
TURN = np.linspace(0.0, 2 * np.pi, 400)
EIGHT = np.column_stack([0.04 * np.sin(TURN), 0.02 * np.sin(2 * TURN)])
HAIRPIN = np.array([[0.0, 0.0], [0.10, 0.0], [0.10, 0.004], [0.0, 0.004]])
"""There and back, 4 mm apart: less than a width."""


def along(path: np.ndarray) -> PathAssistance:
    return PathAssistance(path, **GIVEN, **OPTIONS)  # type: ignore[arg-type]


def walk(helper: PathAssistance, corners: ArrayLike, speed: float = 0.1) -> None:
    """From corner to corner, at this speed [m/s]."""
    corners = np.asarray(corners)
    for begin, end in itertools.pairwise(corners):
        for part in np.linspace(0.0, 1.0, 2 + round(np.linalg.norm(end - begin) / (speed * helper.dt))):
            helper.step(begin + part * (end - begin))


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


def test_branches_closer_than_a_width_are_told_apart() -> None:
    """The whole field rests between the branches of a hairpin; the spring on the branch that the hand has come to."""
    hand = np.array([0.05, 0.0])
    whole = Assistance(PotentialField(HAIRPIN, **GIVEN, rest_on_target=False), mode="follow", **OPTIONS)  # type: ignore[arg-type]
    helper = along(HAIRPIN)
    walk(helper, [[0.0, 0.0], [0.05, 0.0]])
    assert abs(settled(whole, hand)[1]) > 2.0
    assert abs(settled(helper, hand)[1]) < 0.05
    walk(helper, [[0.05, 0.0], [0.092, 0.0], [0.092, 0.004]])  # onto the other stretch, a detour of 4 widths on
    assert helper.reference_progress == pytest.approx(0.092 / 0.204, abs=0.001)
    walk(helper, [[0.092, 0.004], [0.092, 0.0], *HAIRPIN[1:3], [0.05, 0.004]])
    assert abs(settled(helper, np.array([0.05, 0.004]))[1]) < 0.05
    assert helper.reference_progress == helper.progress == pytest.approx((0.10 + 0.004 + 0.05) / 0.204, abs=0.001)


def test_s_follows_the_hand_either_way_and_the_progress_never_goes_back() -> None:
    helper, seen = along(HAIRPIN), [0.0]
    for x in np.concatenate([np.linspace(0.0, 0.08, 300), np.linspace(0.08, 0.03, 300)]):
        helper.step([x, 0.0])
        seen.append(helper.progress)
    assert np.diff(seen).min() >= 0.0
    assert helper.progress == pytest.approx(0.08 / 0.204, abs=1e-4)
    assert helper.reference_progress == pytest.approx(0.03 / 0.204, abs=1e-4)
    helper.reset()
    assert helper.progress == helper.reference_progress == 0.0


@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_a_path_that_turns_back_on_its_own_line_is_gone_to_its_end(noise: float) -> None:
    """Both ways are as near: s takes the way ahead."""
    helper, rng = along(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]])), np.random.default_rng(0)
    for x in [*np.linspace(0.0, 0.1, 1000), *np.linspace(0.1, 0.0, 1000)]:
        helper.step([x, 0.0] + noise * rng.standard_normal(2))
    assert helper.progress == 1.0


@pytest.mark.parametrize("seed", range(1))
def test_the_spring_pulls_to_the_place_nearest_to_the_hand_within_two_widths(seed: int) -> None:
    """So the help has no lead. The oracle for the distance is shapely."""
    helper, rng = along(EIGHT), np.random.default_rng(seed)
    count = round(helper.path_model[PATH_MODEL["last"]])
    samples = shapely.LineString(EIGHT).interpolate(np.linspace(0.0, 1.0, count + 1), normalized=True)
    samples = shapely.get_coordinates(samples)
    hand, pace, place, s, off = EIGHT[0].copy(), rng.choice([0.5, 1.0]), samples[0], 0.0, []
    rare = []
    for k in range(2800):
        hand = hand + 3e-4 * rng.standard_normal(2) + 0.05 * (EIGHT[int(pace * k / 8)] - hand)
        helper.step(hand, np.zeros(2))
        np.testing.assert_allclose(helper.desired_force, GIVEN["stiffness"] * (place - hand), atol=0.01)
        window = samples[max(int(s) - 8, 0) : int(s) + 8 + 2]  # a width is 4 samples
        before, s = s, helper.reference_progress * count
        capped = abs(s - before) * helper.path_model[PATH_MODEL["spacing"]] > 0.999 * helper.speed_cap * helper.dt
        first = min(int(s), count - 1)
        place = samples[first] + (s - first) * (samples[first + 1] - samples[first])
        off.append(shapely.distance(shapely.LineString(window), shapely.Point(hand)))
        assert capped or np.linalg.norm(place - hand) <= off[-1] + 3e-6
        rare.append(capped)
    assert max(off) > 1e-3
    assert np.mean(rare) < 0.01
    assert 0.3 < helper.progress < 1.0


def test_s_is_no_faster_than_the_speed_cap() -> None:
    helper = PathAssistance([[0.0, 0.0], [0.2, 0.0]], **GIVEN, **OPTIONS | {"speed_cap": 0.5})  # type: ignore[arg-type]
    reached = [0.0]
    for x in np.r_[np.arange(0.0, 0.008, 4.5e-4), np.full(30, 0.008)]:
        helper.step([x, 0.0])
        reached.append(0.2 * helper.reference_progress)
    assert np.diff(reached).max() <= 0.5e-3 * (1 + 1e-9)
    assert reached[-1] == pytest.approx(0.008, abs=1e-5)


@pytest.mark.parametrize("angle", [0.3, 2.0])
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


def let_go_at(helper: PathAssistance, hand: ArrayLike) -> list[Command]:
    """The ticks of a hand that stands beside the path until the help lets it go within 0.8 s, and the force is gone."""
    commands = [helper.step(hand + 1e-6 * np.array([k % 2, 0])) for k in range(round(0.8 / helper.dt) + 40)]
    assert commands[-1].status is Status.BLOCKED
    np.testing.assert_array_equal(commands[-1].value, [0.0, 0.0])
    return commands


def test_a_hand_that_stands_under_force_is_let_go_and_held_again_elsewhere_on_the_path() -> None:
    helper = along(np.array([[0.0, 0.0], [0.2, 0.0]]))
    walk(helper, [[0.0, 0.0], [0.13, 0.0]])
    reached = helper.progress
    commands = let_go_at(helper, np.array([0.13, 0.006]))  # 12 N
    assert max(np.linalg.norm(each.value) for each in commands) > 10.0
    assert helper.reference_progress == pytest.approx(reached, abs=1e-4)
    assert commands[-1].relaxed & Relaxed.TASK
    assert commands[-1].scale == 0.0
    assert "stood under force" in commands[-1].reason
    for y in np.linspace(0.006, 0.0, 100):  # no hold where the help let the hand go
        assert helper.step([0.13, y]).status is Status.BLOCKED
    for at, x in ((0.13, 0.10), (0.10, 0.16)):  # back, and further on
        walk(helper, [[at, 0.001], [x, 0.001]])
        assert settled(helper, np.array([x, 0.001]), 400)[1] == pytest.approx(-2.0, abs=0.05)
        assert helper.reference_progress == pytest.approx(x / 0.2, abs=1e-3)
        let_go_at(helper, np.array([x, 0.006]))


def test_a_path_that_goes_twice_round_takes_no_hand_in_a_whole_round_ahead() -> None:
    turns = np.linspace(0.0, 4 * np.pi, 800)
    helper = along(0.02 * np.column_stack([np.cos(turns), np.sin(turns)]))

    def at(turn: float, radius: float = 0.02) -> np.ndarray:
        return radius * np.array([math.cos(turn), math.sin(turn)])

    walk(helper, [at(turn) for turn in np.linspace(0.0, 2.0, 50)])
    for turn, to in ((2.0, 3.0), (3.0, 1.5), (1.5, 4.5)):
        let_go_at(helper, at(turn, 0.026))
        walk(helper, [at(turn, 0.03), at(to, 0.045), at(to, 0.02)], speed=0.4)
        settled(helper, at(to), 400)
        assert helper.reference_progress == pytest.approx(to / (4 * math.pi), abs=0.01)
    assert helper.progress < 0.5


@pytest.mark.parametrize("hertz", [1.5])
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


@pytest.mark.parametrize("place", [(0.03, 0.0), (-300.0, 500.0)], ids=["centre", "millimetres"])
def test_a_hand_that_is_not_at_the_path_covers_nothing_of_it(place: tuple[float, float]) -> None:
    """With 0.02 mm of noise a hand at the centre of a circle went round it, and one 583 m away came to the end."""
    circle = 0.03 * np.column_stack([1 - np.cos(TURN), np.sin(TURN)])
    helper, rng = along(circle), np.random.default_rng(3)
    for _ in range(3000):
        command = helper.step(place + 2e-5 * rng.standard_normal(2))
    assert helper.progress == helper.reference_progress == 0.0
    assert command.status is Status.BLOCKED


@pytest.mark.parametrize("unseen", [{"enable": False}, {"x": (math.nan, 0.0)}, None], ids=["released", "NaN", "begun"])
def test_a_hand_that_went_on_unseen_is_held_where_it_is_and_not_pulled_back(unseen: dict[str, Any] | None) -> None:
    helper = along(np.array([[0.0, 0.0], [0.2, 0.0]]))
    if unseen is not None:
        for _ in range(50):
            helper.step((0.0, 0.0))
        for x in np.linspace(0.0, 0.08, 500):
            helper.step(**{"x": (x, 0.0), **unseen})
    assert helper.progress == 0.0
    for k in range(1000):
        command = helper.step((0.08, 1e-6 * (k % 2)))
        assert np.linalg.norm(command.value) < 0.5
    assert command.status is Status.OK
    assert helper.reference_progress == pytest.approx(0.4, abs=0.01)


def test_what_cannot_be_used_is_named() -> None:
    paths: list[Any] = [
        [[0.0, 0.0], [0.1, 0.0, 0.0]], [EIGHT, EIGHT], np.stack([EIGHT, EIGHT]), [[0.0, 0.0]], [[0.1, 0.0], [0.1, 0.0]],
        [[0.0, math.nan], [1.0, 0.0]], np.full((400, 2), 1j),
    ]  # fmt: skip
    refuses(along, *(((path,), "path = ") for path in paths), ((EIGHT + 1.0,), "path = ", "outside `comfortable`"))
    settings: list[tuple[str, Any]] = [
        ("width", math.nan), ("width", "wide"), ("width", 1e-9), ("stiffness", -1.0), ("comfortable", None),
        ("damping", -1.0),
    ]  # fmt: skip
    given = {"path": HAIRPIN, **GIVEN, **OPTIONS}
    refuses(PathAssistance, *(({**given, name: value}, name) for name, value in settings))
    assert along(EIGHT + [0.32, 0.0]).progress == 0.0  # partly
