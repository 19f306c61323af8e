"""Claims about assistance along a path that comes back to where it was."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import ArrayLike

from rehab_opt import Assistance, Command, PotentialField, Status, Workspace
from rehab_opt.control.path_assistance import PathAssistance
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


@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_a_path_that_turns_back_on_its_own_line_is_gone_to_its_end(noise: float) -> None:
    """Both ways are as near: s takes the way ahead."""
    helper, rng = along(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]])), np.random.default_rng(0)
    for x in [*np.linspace(0.0, 0.1, 1000), *np.linspace(0.1, 0.0, 1000)]:
        helper.step([x, 0.0] + noise * rng.standard_normal(2))
    assert helper.progress == 1.0


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


@pytest.mark.parametrize(
    ("place", "status", "reason"),
    [((0.03, 0.0), Status.BLOCKED, ""), ((-300.0, 500.0), Status.RELEASED, "is it in metres?")],
    ids=["centre", "millimetres"],
)
def test_a_hand_that_is_not_at_the_path_covers_nothing_of_it(
    place: tuple[float, float], status: Status, reason: str
) -> None:
    """With 0.02 mm of noise a hand at the centre of a circle went round it, and one 583 m away came to the end."""
    circle = 0.03 * np.column_stack([1 - np.cos(TURN), np.sin(TURN)])
    helper, rng = along(circle), np.random.default_rng(3)
    for _ in range(3000):
        command = helper.step(place + 2e-5 * rng.standard_normal(2))
    assert helper.progress == helper.reference_progress == 0.0
    assert command.status is status
    assert reason in command.reason


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
