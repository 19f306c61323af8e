"""Claims about a push on a led hand: what it gives way, returns, gives out, and when the arm stops."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from rehab_opt import Interaction, MirrorTracker, ur5
from rehab_opt.control.interaction import FELT
from rehab_opt.symbolic import BufferedFunction
from tests.refusals import refuses

Array = NDArray[np.float64]


def direction(rng: np.random.Generator) -> Array:
    way = rng.normal(size=3)
    return np.asarray(way / np.linalg.norm(way))


def stored(law: Interaction, x: Array, v: Array) -> float:
    return float(law.mass * v @ v + law.stiffness * x @ x) / 2


class Felt:
    """Displacement and pace that the forces so far lead to."""

    def __init__(self, law: Interaction, dt: float) -> None:
        self.law, self.state, self._felt = law, law.start, BufferedFunction(law.felt_function(dt))

    @property
    def offset(self) -> Array:
        """(3,) [m] displacement of the reference."""
        return self.state[:3]

    @property
    def velocity(self) -> Array:
        """(3,) [m/s] of the displacement."""
        return self.state[3:6]

    @property
    def pace(self) -> float:
        """Share of its pace that the reference keeps."""
        return float(self.state[FELT["pace"]])

    @property
    def energy(self) -> float:
        """[J] left in the tank; below zero it owes."""
        return float(self.state[FELT["tank"]])

    @property
    def active(self) -> bool:
        """Whether forces are measured, or the last of them is not over yet."""
        return bool(self.state[FELT["active"]])

    def feel(self, force: ArrayLike | None, away: Array) -> str:
        """Take one measurement (3,) [N], None for none; why the arm must stop, or nothing.

        `away` (3,) [m] is how far the hand is off the reference of the last tick, NaN where that is not known.
        """
        self.state = self._felt.of(np.zeros(3) if force is None else force, force is not None, self.state, away)
        return ("", "force is not a valid number", self.law.too_large(self.state))[int(self._felt.outputs[1][0])]


def pushes(rng: np.random.Generator, ticks: int, dt: float) -> dict[str, Array]:
    """(ticks, 3) [N] of several kinds."""
    t = dt * np.arange(ticks)[:, None]
    shock = np.zeros((ticks, 3))
    for start in range(0, ticks, ticks // 5):
        shock[start : start + 4] = 130.0 * direction(rng)
    turning = np.hstack([np.sin(9.0 * t), np.cos(9.0 * t), np.sin(5.0 * t + 1.0)])
    return {
        "sine": 25.0 * direction(rng) * np.sin(2 * math.pi * rng.uniform(0.3, 12.0) * t),
        "shocks": shock,
        "noise": 20.0 * rng.normal(size=(ticks, 3)),
        "round and round": 60.0 * turning,
    }


@pytest.mark.parametrize("dt", [1e-3, 2e-2])
def test_a_hand_that_follows_gives_out_no_more_than_was_put_in_tick_by_tick(dt: float) -> None:
    rng = np.random.default_rng(3)
    for law in (Interaction(), Interaction(max_offset=0.01, speed=0.05), Interaction(mass=0.1, damping=20.0)):
        for force in pushes(rng, round(3.0 / dt), dt).values():
            felt, x, v = Felt(law, dt), np.zeros(3), np.zeros(3)
            for each in force:
                assert felt.feel(each, x) == ""
                after, speed = felt.offset.copy(), felt.velocity.copy()
                put_in = each @ (after - x) - (stored(law, after, speed) - stored(law, x, v))
                assert put_in >= law.damping * speed @ speed * dt - 1e-9
                assert np.linalg.norm(after) <= law.max_offset + 1e-12
                assert np.linalg.norm(after - x) <= law.speed * dt * (1 + 1e-9)
                x, v = after, speed


@pytest.mark.parametrize("late", [20])
def test_a_late_hand_gives_out_no_more_than_the_reserve(late: int) -> None:
    """Shaken at the frequencies where a delay is worst, for long."""
    dt, law, rng = 1e-3, Interaction(), np.random.default_rng(late)
    for hertz in (3.0, 8.0, 15.0, 25.0):
        felt, way = Felt(law, dt), direction(rng)
        places, given, worst = [np.zeros(3)] * (late + 1), 0.0, 0.0
        for k in range(4000):
            force = 60.0 * way * math.sin(2 * math.pi * hertz * k * dt)
            hand = places[-late - 1]
            felt.feel(force, hand)
            places.append(felt.offset.copy())
            given -= float(force @ (places[-late - 1] - hand))
            worst = max(worst, given - 0.02 * k * dt)
        assert worst <= law.reserve + 1e-3, (hertz, felt.energy)


@pytest.mark.parametrize("most", [0.05, 0.01])
def test_a_step_of_force_follows_the_closed_form_of_mass_damper_and_spring(most: float) -> None:
    dt, law, force = 1e-4, Interaction(max_offset=most), 15.0
    felt, x = Felt(law, dt), np.zeros(3)
    slow, fast = np.roots([law.mass, law.damping, law.stiffness])
    for k in range(1, 10_001):
        felt.feel([0.0, force, 0.0], x)
        x = felt.offset.copy()
        t = k * dt
        fraction = 1 + (fast * math.exp(slow * t) - slow * math.exp(fast * t)) / (slow - fast)
        assert x[1] == pytest.approx(min(force / law.stiffness * fraction, most), abs=2e-5)
        assert not x[[0, 2]].any()


@pytest.mark.parametrize("dt", [1e-2])
def test_what_is_refused_is_not_wound_up_and_what_is_not_refused_is_given(dt: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        law, normal, force = Interaction(), direction(rng), 28.0 * direction(rng)
        room = rng.uniform(0.0, 0.02)  # the hand goes no farther than this along the normal
        felt, hand = Felt(law, dt), np.zeros(3)
        for _ in range(round(2.0 / dt)):
            felt.feel(force, hand)
            wanted = felt.offset
            hand = wanted - max(float(wanted @ normal) - room, 0.0) * normal
            assert np.linalg.norm(wanted - hand) <= 5e-3 + 2 * law.speed * dt + law.speed * dt + 1e-9
        assert np.linalg.norm(felt.velocity) < 0.01
        tangent = np.eye(3) - np.outer(normal, normal)
        np.testing.assert_allclose(tangent @ hand, tangent @ force / law.stiffness, atol=5e-3)


def test_a_push_is_answered_where_the_hand_is_behind_its_reference() -> None:
    law, dt = Interaction(), 1e-3
    behind = np.array([-0.04, 0.0, 0.0])  # the hand waits before a bound
    for way, gives in (([0, 1.0, 0], True), ([-1.0, 0, 0], True), ([1.0, 0, 0], False)):
        felt, hand = Felt(law, dt), behind
        for _ in range(1500):
            felt.feel(25.0 * np.array(way), hand)
            hand = behind + felt.offset * gives
        assert np.linalg.norm(felt.offset) == pytest.approx(25.0 / law.stiffness * gives, rel=0.05, abs=1e-9)


@pytest.mark.parametrize(("stop_at", "dt"), [(30.0, 2e-2), (140.0, 1e-3)])
def test_a_force_at_the_stop_does_not_chatter_and_is_released_with_hysteresis(stop_at: float, dt: float) -> None:
    law, rng = Interaction(stop_at=stop_at), np.random.default_rng(1)
    felt, way = Felt(law, dt), direction(rng)
    rise = np.linspace(0.0, stop_at, round(2 / dt))
    sizes = np.concatenate([rise, np.full(round(3 / dt), stop_at), rise[::-1]])
    said = [bool(felt.feel(size * way + rng.normal(size=3) * 2.0, felt.offset)) for size in sizes.tolist()]
    assert sum(a != b for a, b in itertools.pairwise(said)) == 2
    first, last = said.index(True), len(said) - said[::-1].index(True)
    assert sizes[first] >= stop_at - 12.0
    assert sizes[last] < law.release * stop_at + 12.0
    assert last - len(said) + round(2 / dt) > (1 - law.release) * 0.8 * round(2 / dt) + law.hold / dt * 0.5


@pytest.mark.parametrize("dt", [2e-2])
def test_after_a_shock_the_arm_stands_for_the_least_time(dt: float) -> None:
    law = Interaction()
    felt = Felt(law, dt)
    assert "at most 140 N" in felt.feel([0.0, 150.0, 0.0], np.zeros(3))
    said = [felt.feel(force, np.zeros(3)) for force in ([0.0] * 3, None) for _ in range(round(0.2 / dt))]
    stopped = sum(map(bool, said))
    assert stopped == math.ceil(law.hold / dt - 0.5 - 1e-9) - 1
    assert "below 98 N" in said[0]
    assert not felt.velocity.any()


def test_the_pace_falls_at_once_stands_at_the_limit_and_comes_back_gently() -> None:
    law, dt = Interaction(), 1e-3
    felt = Felt(law, dt)
    felt.feel([0.0, 0.0, 19.0], np.zeros(3))
    assert felt.pace == pytest.approx(0.5)
    felt.feel([0.0, 31.0, 0.0], np.zeros(3))
    assert felt.pace == 0.0
    rng, paces = np.random.default_rng(0), []
    for _ in range(500):
        felt.feel(28.0 * np.array([1.0, 0, 0]) + 2.0 * rng.normal(size=3), felt.offset.copy())
        paces.append(felt.pace)
    assert max(paces) < 0.1
    before = felt.pace
    while felt.active:
        felt.feel(None, felt.offset.copy())
        assert felt.pace <= before + 2.0 * dt + 1e-12
        before = felt.pace
    assert before == 1.0


@pytest.mark.parametrize("bad", [math.nan, 1e308])
def test_a_force_that_is_no_number_stops_and_leaves_no_speed(bad: float) -> None:
    felt = Felt(Interaction(), 1e-3)
    for _ in range(100):
        felt.feel([20.0, 0.0, 0.0], felt.offset.copy())
    before = felt.offset.copy()
    assert felt.feel([bad, bad, 0.0], before)
    assert np.linalg.norm(felt.offset - before) < 1e-3
    assert felt.pace == 0.0
    assert not felt.velocity.any()
    for _ in range(1000):
        felt.feel(None, felt.offset.copy())
    assert np.all(np.isfinite(felt.offset))
    assert np.linalg.norm(felt.offset) < 1e-3


NUMBERS = ("limit", "stop_at", "release", "hold", "stiffness", "damping", "mass", "speed", "reserve")


def test_what_cannot_be_used_is_named() -> None:
    for value in (0.0, -1.0, math.nan, "1"):
        refuses(Interaction, *(({"slow_from": 0.0, name: value}, name) for name in NUMBERS))
    for order in ({"stop_at": 20.0}, {"release": 1.0}, {"slow_from": 30.0}, {"slow_from": None}):
        refuses(Interaction, (order, next(iter(order))))
    refuses(functools.partial(MirrorTracker, ur5()), ({"interaction": 30.0}, "interaction = 30"))
