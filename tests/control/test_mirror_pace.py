"""Pace of a mirrored hand's reference, by numbers worked out by hand."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt.control.interaction import FELT
from rehab_opt.control.mirror_pace import COUNTED, PACE, REMEMBERED, SAID, TRIED, MirrorPace
from rehab_opt.control.reference_clock import CLOCK, SAMPLE
from rehab_opt.symbolic import BufferedFunction

Array = NDArray[np.float64]
DT = 0.01
OF = MirrorPace(dt=DT, linear_speed=0.25, angular_speed=1.5, max_deviation=0.05, max_turn=0.8, catch_up=0.5)
STILL = np.zeros(6)


def pose(x: float = 0.0, angle: float = 0.0) -> Array:
    """(16,) by rows, turned about y."""
    found = np.eye(4)
    found[:3, :3], found[0, 3] = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix(), x
    return found.ravel()


def memory(*, pace: dict[str, float], push: float = 1.0, counts: float = 0.0) -> Array:
    return REMEMBERED.numbers(
        pace=PACE.numbers(**{"rate": 1, "waited": 0, "stood": 0, "apart": 0, "aside": 0} | pace),
        held=0.0, felt=FELT.numbers(**dict.fromkeys(FELT.places, 0.0) | {"pace": push}), aim=math.nan, then=1.0,
        live=1.0, counted=counts,
    )  # fmt: skip


def window(*samples: tuple[Array, Array, float]) -> Array:
    """(20, window) of poses, twists and the seconds since the sample before."""
    rows = [SAMPLE.numbers(pose=each[:12], twist=twist, seconds=seconds, stamp=0.0) for each, twist, seconds in samples]
    return np.array(rows + [np.zeros(SAMPLE.size)] * (OF.window - len(rows))).T


@cache
def function(name: str) -> BufferedFunction:
    return BufferedFunction(OF.tried_function() if name == "tried" else OF.concluded_function(person=False))


def tried(
    *, lag: float = 0.0, twist: Array = STILL, here: Array | None = None, far: float = 0.0, seconds: float = DT,
    most: float = math.inf, hurried: bool = True, push: float = 1.0, **pace: float,
) -> dict[str, Any]:  # fmt: skip
    """`TRIED` of a clock that is `lag` late, half of the way to a sample that is `far` away; and the rate."""
    samples = window((pose(), twist, DT), (pose(far), twist, seconds), (pose(far), twist, DT))
    clock = CLOCK.numbers(ahead=2, fraction=0.0, lag=lag, lost=0.0, newest=0.0)
    given = function("tried")
    near = given.of(samples, clock, memory(pace=pace, push=push), (hurried, most), pose() if here is None else here)
    found = given.outputs[1]
    return {"rate": near[0], **{name: found[place].copy() for name, place in TRIED.places.items()}}


LINEAR, ANGULAR = np.r_[0.5, np.zeros(5)], np.r_[np.zeros(4), 3.0, 0.0]


@pytest.mark.parametrize(
    ("given", "rate"),
    [
        ({"rate": 0.3}, 0.3 + DT / 0.1),  # it quickens by 1 in 0.1 s
        ({"most": 0.2}, 0.2),
        ({"push": 0.4, "rate": 2.0, "lag": 0.1}, 0.4),  # nobody is hurried who pushes
        ({"twist": LINEAR}, 0.95 * 0.25 / 0.5),
        ({"twist": ANGULAR}, 0.95 * 1.5 / 3.0),
        ({"lag": 0.1, "far": 0.005, "rate": 9.0}, 1 + 0.09 / 0.3 + 0.02),
        ({"lag": 0.5, "far": 0.005, "rate": 9.0}, 1.5),  # `catch_up`
        ({"lag": 0.1, "far": 0.005, "rate": 9.0, "hurried": False}, 1.0),
        ({"lag": 0.1, "rate": 9.0}, 5.0),  # what rests is passed at full haste
        ({"lag": 0.1, "rate": 9.0, "seconds": 0.0}, 5.0),  # also where a bridge ends
        ({"lag": 0.1, "far": 0.99e-4, "rate": 9.0}, 5.0),
        ({"lag": DT, "rate": 9.0}, 1.0),
        ({"here": pose(0.04)}, (0.9 - 0.8) / 0.45),
        ({"here": pose(0.04), "apart": 0.02}, 1.0),
        ({"here": pose(0.0, 0.64)}, (0.9 - 0.8) / 0.45),
        ({"here": pose(0.0, 0.64), "aside": 0.32}, 1.0),
        ({"here": pose(0.046)}, 0.0),
    ],
)
def test_pace_is_what_lag_speeds_deviation_and_pushes_leave(given: dict[str, Any], rate: float) -> None:
    found = tried(**given)
    assert found["rate"] == pytest.approx(rate, abs=1e-9)
    assert found["seconds"][0] == pytest.approx(rate * DT, abs=1e-9)
    np.testing.assert_allclose(found["twist"], rate * given.get("twist", STILL), atol=1e-9)
    np.testing.assert_array_equal(found["motion"], found["twist"])


AT_REST = dict.fromkeys(TRIED.places, 0.0)


@pytest.mark.parametrize(
    ("speed", "rate", "ticks", "waits"),
    [
        (0.0, 0.5, 11, False),  # for 0.1 s
        (0.0049, 0.5, 11, False),
        (0.0051, 0.5, None, False),
        (0.1, 0.01, 100, True),
        (0.1, 1.0, None, False),
    ],
)
def test_a_hand_that_stands_or_a_clock_that_waits_cuts_the_hand_short(
    speed: float, rate: float, ticks: int | None, waits: bool
) -> None:
    given, before = function("concluded"), memory(pace={"rate": rate})
    samples, clock = window(*[(pose(), STILL, DT)] * 9), CLOCK.numbers(ahead=8, fraction=0, lag=0.08, lost=0, newest=0)
    taken = TRIED.numbers(
        **AT_REST | {"pose": pose(0.03), "target": pose(0.02), "goal": pose(0.03, 0.2)[:12], "seconds": 0.005}
    )
    hand = speed * np.eye(6)[0]
    for k in range(1, 121):
        near = before[REMEMBERED.places["pace"]].copy()
        before = given.of(samples, clock, near, pose(), hand, taken, before)
        counts = dict(zip(COUNTED.places, before[REMEMBERED.places["counted"]], strict=True))
        cut = before[REMEMBERED["pace"] + PACE["apart"]] > 0
        assert cut == (ticks is not None and k >= ticks), k
        assert counts["waited"] == k * waits
    assert (counts["cut"] > 0) == (ticks is not None)
    _, said, after, _ = given.outputs
    np.testing.assert_allclose(
        said, SAID.numbers(passed=0, ahead=8, bridging=0, short=cut, beyond=[0.01, 0.0]), atol=1e-9
    )
    np.testing.assert_allclose(after, CLOCK.numbers(ahead=8, fraction=0.5, lag=0.075, lost=0, newest=0))
    if cut:
        np.testing.assert_allclose(before[REMEMBERED["pace"] + 3 : REMEMBERED["pace"] + 5], [0.03, 0.2])
