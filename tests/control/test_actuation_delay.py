"""Claims about forces that act late: the work of the force that truly acts stays within the budget."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt.control.bounded_force import BoundedForce

Array = NDArray[np.float64]
CAP = 1.0


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


def test_a_clock_that_is_set_back_takes_no_time_from_what_acts_late() -> None:
    """Beside a stamp that is repeated once, of a force that turns as the hand goes."""
    left = []
    for back in (0.0, 0.03):
        force = BoundedForce(
            lambda x, y, vx, vy: (20 * math.cos(150 * x), 20 * math.sin(150 * x)), actuation_delay=0.05, compile=False
        )
        x, stamp, sent = 0.0, 0.0, list[tuple[float, ...]]()
        for k in range(400):
            stamp += 1e-3 if k != 200 else -back
            x += 0.9e-3 * (k % 100 < 70)
            value = force.step([x, 0.0], stamp=stamp).value
            sent.append((*value, force.energy_left))
        left.append(sent)
    np.testing.assert_allclose(left[1], left[0], rtol=0, atol=1e-9)


def test_a_wanted_force_that_is_too_large_for_a_float_releases() -> None:
    huge = [0]
    force = BoundedForce(lambda *_: (huge[0], 0.0), compile=False)
    assert force.step([0.0, 0.0]).status.value == "ok"
    huge[0] = 10**400
    command = force.step([0.0, 0.0])
    assert command.status.value == "released"
    assert "field" in command.reason or "number" in command.reason
