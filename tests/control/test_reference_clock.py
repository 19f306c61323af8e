"""The clock gives back the path it was handed, at whatever pace; jumps become bridges."""

import functools
import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from rehab_opt.control import reference_clock
from rehab_opt.control.between_poses import angle_of, distance_of, turn_between, turned
from rehab_opt.control.reference_clock import CLOCK, SAMPLE, WINDOW, ClockStatement, ReferenceClock
from rehab_opt.symbolic import BufferedFunction

DT = 0.01


@functools.cache
def advanced() -> BufferedFunction:
    """Samples' seconds, `CLOCK`, [s] -> samples passed, `CLOCK`."""
    lengths, at, seconds = ca.SX.sym("lengths", WINDOW), CLOCK.symbols("clock"), ca.SX.sym("seconds")
    passed, after = ClockStatement(DT).advanced(lengths, at, seconds, ca.SX(1))
    return BufferedFunction(ca.Function("advanced", [lengths, at.column, seconds], [passed, after.column]))


def advance(made: ReferenceClock, seconds: float) -> None:
    """Go on by this much reference time, at most to the newest sample and over as many as the window has."""
    advanced().of(made.window[:, SAMPLE["seconds"]], made.now, seconds)
    passed, (_, fraction, lag, *_) = advanced().outputs
    made.stand(int(passed[0]), float(fraction), float(lag))


def pose(x: float, angle: float = 0.0) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3] = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    found[0, 3] = x
    return found


def clock(n: int, *, speed: float = 0.1) -> ReferenceClock:
    made = ReferenceClock(DT, linear_speed=0.1, angular_speed=0.5)
    made.start(pose(0.0), np.array([speed, 0, 0, 0, 0, 0]))
    for k in range(1, n):
        made.push(pose(speed * k * DT), np.array([speed, 0, 0, 0, 0, 0]))
    return made


@given(st.lists(st.floats(0.0, 2.0), max_size=400))
@settings(deadline=None, max_examples=15)
def test_read_where_the_paces_add_up_to(paces: list[float]) -> None:
    made, gone = clock(300), 0.0
    for pace in paces:
        advance(made, pace * DT)
        gone = min(gone + pace * DT, 299 * DT)
        assert made.read()[0][0, 3] == pytest.approx(0.1 * gone, abs=1e-12)
        assert made.lag == pytest.approx(299 * DT - gone, abs=1e-9)
        assert made.current == (gone >= 299 * DT - 1e-12) or abs(gone - 299 * DT) < 1e-9
    ahead = made.read(0.05)[0][0, 3]
    assert ahead == pytest.approx(0.1 * min(gone + 0.05, 299 * DT), abs=1e-12)


def test_a_bridge_is_straight_even_and_calm() -> None:
    made = clock(2)
    made.push(pose(0.501, math.pi / 2), np.zeros(6), bridge=True)
    advance(made, DT)
    assert made.bridging
    turns = Slerp([0, 1], Rotation.from_rotvec([[0, 0, 0], [0, math.pi / 2, 0]]))
    duration = made.lag
    assert duration == pytest.approx(max(0.5 / 0.1, math.pi / 2 / 0.5))
    for fraction in (0.1, 0.5, 0.9):
        between, twist = made.read(fraction * duration)
        assert between[0, 3] == pytest.approx(0.001 + 0.5 * fraction)
        np.testing.assert_allclose(between[:3, :3], turns(fraction).as_matrix(), atol=1e-9)
        assert np.linalg.norm(twist[:3]) <= 0.1 + 1e-9


def test_a_clock_that_waits_for_ever_keeps_the_path_and_bounds_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference_clock, "THINNED", 100)
    made = clock(1000)
    assert made.waiting <= 100
    assert made.lag == pytest.approx(999 * DT)
    advance(made, 4.56)
    assert made.read()[0][0, 3] == pytest.approx(0.456, abs=1e-9)


def test_looking_ahead_the_pace_falls_in_time() -> None:
    made = ReferenceClock(DT, linear_speed=0.1, angular_speed=0.5)
    made.start(pose(0.0), np.zeros(6))
    for k in range(1, 200):
        made.push(pose(0.0), np.array([0.05 if k < 100 else 0.4, 0, 0, 0, 0, 0]))
    made.slow_ahead(linear_speed=0.1, angular_speed=0.5, quickening=0.1)
    paces = []
    for _ in range(199):
        paces.append(made.pace)
        advance(made, DT)
    assert paces[150] == pytest.approx(0.25)
    assert paces[50] >= 1.0
    assert paces[98] < 1.0
    squares = np.array(paces[90:110]) ** 2
    assert np.diff(squares).min() >= -2 * DT / 0.1 - 1e-12


@given(st.integers(0, 2**32 - 1))
def test_turns_between_poses_are_scipys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = np.eye(4), np.eye(4)
    first = Rotation.random(rng=rng)
    vector = rng.standard_normal(3)
    vector *= rng.choice([1e-9, 1e-3, 1.0, math.pi - 1e-4, math.pi]) / np.linalg.norm(vector)
    a[:3, :3] = first.as_matrix()
    b[:3, :3] = (Rotation.from_rotvec(vector) * first).as_matrix()
    a[:3, 3], b[:3, 3] = rng.standard_normal((2, 3))
    np.testing.assert_allclose(turned(a[:3, :3], turn_between(a, b)), b[:3, :3], atol=1e-7)
    columns = [ca.DM(each.ravel()) for each in (a, b)]
    assert float(angle_of(*columns)) == pytest.approx(np.linalg.norm(vector), abs=1e-6)
    assert float(distance_of(*columns)) == pytest.approx(np.linalg.norm(a[:3, 3] - b[:3, 3]))


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=5)
def test_what_is_laid_out_is_where_the_clock_comes_to(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speeds = np.abs(np.cumsum(rng.normal(0.0, 0.05, 120)))
    places, angles = np.cumsum(speeds) * DT, np.cumsum(rng.normal(0.0, 0.02, 120))
    poses = np.array([pose(x, angle) for x, angle in zip(places, angles, strict=True)])
    twists = np.zeros((120, 6))
    twists[:, 0], twists[:, 4] = speeds, np.gradient(angles, DT)
    made = ReferenceClock(DT, linear_speed=0.1, angular_speed=0.5)
    made.start(poses[0], twists[0])
    made.extend(poses[1:], twists[1:], np.full(119, DT))
    made.slow_ahead(linear_speed=0.25, angular_speed=1.5, quickening=0.1)
    for _ in range(7):
        advance(made, 0.37 * DT)
    laid = made.preview(linear_speed=0.25, angular_speed=1.5).ahead((0, made.fraction), 0.3, 200, dt=DT, quickening=0.1)
    assert len(laid.paces) == 200
    before, rate = made.passed, 0.3
    for there, twist, pace in zip(laid.poses, laid.twists, laid.paces, strict=True):
        assert pace <= min(1.0, made.pace, rate + 0.1) + 1e-12
        advance(made, pace * DT)
        found, motion = made.read()
        np.testing.assert_allclose(there, found, atol=3e-4)  # entries of near turns stand for the arc there
        assert math.hypot(*twist[:3]) <= 0.25
        assert math.hypot(*twist[3:]) <= 1.5
        fraction = float(np.linalg.norm(twist)) / max(float(np.linalg.norm(pace * motion)), 1e-12)
        assert fraction <= 1 + 1e-9
        np.testing.assert_allclose(twist, fraction * pace * motion, atol=1e-9)
        rate = pace
    assert made.current == (before + laid.places[-1][0] == 119)
