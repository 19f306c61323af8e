"""Claims about forces that act late: the work of the force that truly acts stays within the budget."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt.control.bounded_force import BoundedForce

Array = NDArray[np.float64]
CAP = 1.0


class LateHand:
    """A force that acts a while after it was sent, through a first-order lag, and the work that it does on a hand."""

    def __init__(self, *, delay: float, lag: float, dt: float) -> None:
        self.lag, self.fine = lag, 4
        self.step = dt / self.fine
        self.pipe = deque([np.zeros(2)] * round(delay / self.step))
        self.force, self.work = np.zeros(2), 0.0

    def moved(self, sent: Array, way: Array) -> None:
        """The hand goes straight, evenly, while this force is sent for a tick."""
        for _ in range(self.fine):
            self.pipe.append(sent)
            arrives = self.pipe.popleft()
            after = arrives + (self.force - arrives) * (math.exp(-self.step / self.lag) if self.lag else 0.0)
            self.work += float((self.force + after) @ way) / (2 * self.fine)
            self.force = after


@pytest.mark.parametrize(("delay", "jitter", "slower"), [(0.05, 0.9, 1), (0.1, 0.5, 3)], ids=str)
def test_stamps_that_jitter_and_ticks_that_come_late_let_nobody_draw_more(
    delay: float, jitter: float, slower: int
) -> None:
    """A hand goes along a force that turns and acts a long time after it was sent; seconds are what stamps say."""
    tick, clock = 1e-3 * slower, [0.0]
    force = BoundedForce(
        lambda x, y, vx, vy: (25 * math.cos(60 * clock[0]), 25 * math.sin(60 * clock[0])),
        force_limit=25.0, slew_limit=4000.0, energy_budget=1.0, speed_cap=CAP, actuation_delay=delay,
        trust_stillness=True, dt=1e-3, compile=False,
    )  # fmt: skip
    hand, x, most = LateHand(delay=delay, lag=0.0, dt=tick), np.zeros(2), 0.0
    for k in range(3000):
        clock[0] = k * tick
        sent = force.step(x, stamp=clock[0] + jitter * 1e-3 * (k % 2)).value
        size = float(np.linalg.norm(hand.force))
        way = 0.999 * CAP * tick * hand.force / size if size > 1e-9 else np.zeros(2)
        x = x + way
        hand.moved(sent, way)
        most = max(most, hand.work)
    assert 0.3 < most <= 1.0


@pytest.mark.parametrize(("every", "delay"), [(1, 0.02), (10, 0.0)])
def test_a_reset_that_keeps_the_energy_gives_none_away(every: int, delay: float) -> None:
    """The force that acts goes on, since the user says so; what nobody saw is charged."""
    force = BoundedForce(
        lambda x, y, vx, vy: (25.0, 0.0), force_limit=25.0, slew_limit=4000.0, energy_budget=1.0, speed_cap=CAP,
        actuation_delay=delay, dt=1e-3, compile=False,
    )  # fmt: skip
    hand, x, most = LateHand(delay=delay, lag=0.0, dt=1e-3), np.zeros(2), 0.0
    for k in range(3000):
        sent = force.step(x).value
        size = float(np.linalg.norm(hand.force))
        way = 0.999e-3 * CAP * hand.force / size if size > 1e-9 else np.zeros(2)
        x = x + way
        hand.moved(sent, way)
        most = max(most, hand.work)
        if k % every == 0:
            force.reset(energy=False, force=sent)
    assert 0.1 < most <= 1.0


@pytest.mark.parametrize("dt", [0.001, 0.004])
def test_stamps_that_come_in_time_change_nothing(dt: float) -> None:
    """Delay and window are whole ticks: by the rounding of stamps, forces were under way for a tick longer."""
    with_stamps, without = (
        BoundedForce(lambda x, y, vx, vy: (4000.0 * x, -9.0), actuation_delay=0.005, dt=dt, compile=False)
        for _ in range(2)
    )
    for k in range(400):
        x = [0.01 * math.sin(9 * k * dt), 0.02 * math.cos(7 * k * dt)]
        one, other = with_stamps.step(x, stamp=k * dt), without.step(x)
        np.testing.assert_allclose(one.value, other.value, rtol=0, atol=1e-9)
        assert with_stamps.energy_left == pytest.approx(without.energy_left, abs=1e-9)


def steady(newtons: float = 30.0, **options: Any) -> BoundedForce:
    """A constant force along x, of which only energy holds anything back."""
    return BoundedForce(lambda *_: (newtons, 0.0), growth_limit=9e5, compile=False, **options)


@pytest.mark.parametrize("every", [2, 20])
def test_a_hand_at_rest_under_a_constant_force_draws_nothing(every: int) -> None:
    """Its encoder moves by a count now and then; what lags is that same force."""
    force = steady()
    left = []
    for k in range(10_000):
        command = force.step([0.1, 1e-5 * (k // every % 2)])
        left.append(force.energy_left)
    assert command.value[0] == pytest.approx(30.0)
    assert left[999] - left[9999] < 0.05 * every  # a frozen sensor's energy is set aside for so long


@pytest.mark.parametrize("max_age", [0.004, 0.05])
def test_near_an_empty_tank_the_force_does_not_buzz(max_age: float) -> None:
    force = steady(energy_budget=0.8, max_age=max_age)
    sizes = [force.step([0.02e-3 * k, 0.0]).value[0] for k in range(3000)]
    assert max(sizes[200:]) < 29.9
    assert np.abs(np.diff(sizes[200:])).max() < 0.05


@pytest.mark.parametrize(("unsure", "energy"), [(0.0, False), (0.003, True)])
def test_what_a_hand_draws_unseen_after_a_reset_is_counted(energy: bool, unsure: float) -> None:
    """It goes along the force at once, and is seen 300 ticks later."""
    force = steady(slew_limit=50.0, actuation_uncertainty=unsure)
    force.reset(energy=energy, force=(30.0, 0.0))
    x, sent, drawn = 0.0, 30.0, 0.0
    for k in range(600):
        x, drawn = x + 0.99e-3, drawn + 0.99e-3 * sent
        sent = float(force.step([math.nan if k < 300 else x, 0.0]).value[0])
        assert k < 300 or force.energy_left <= 20.0 - drawn + 1e-9


def test_ticks_that_come_late_after_resets_let_nobody_draw_more() -> None:
    force, x, time, sent, drawn = steady(), 0.0, 0.0, 0.0, 0.0
    for k in range(20_000):
        late = 0.045 if k % 50 == 0 else 1e-3
        x, time, drawn = x + 0.99 * late, time + late, drawn + 0.99 * late * sent
        if k % 50 == 0:
            force.reset(energy=False, force=(sent, 0.0))
        sent = float(force.step([x, 0.0], stamp=time).value[0])
    assert 10.0 < drawn <= 20.0


def test_a_wanted_force_that_is_too_large_for_a_float_releases() -> None:
    huge = [0]
    force = BoundedForce(lambda *_: (huge[0], 0.0), compile=False)
    assert force.step([0.0, 0.0]).status.value == "ok"
    huge[0] = 10**400
    command = force.step([0.0, 0.0])
    assert command.status.value == "released"
    assert "field" in command.reason or "number" in command.reason
