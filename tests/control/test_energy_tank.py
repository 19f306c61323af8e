"""Claims about the energy tank: nobody draws more than the budget, whatever is seen of the hand."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.control.energy_tank import EnergyTank, tank_record
from rehab_opt.field.samples import HAND_SPEED
from rehab_opt.symbolic import BufferedFunction

SLEW, CAP, DT, LATE, LIMIT = 200.0, 1.0, 1e-3, 0.05, 30.0


TANK = tank_record(1)


@cache
def function(name: str, window: float = 0.0) -> BufferedFunction:
    """Numbers of the tank, budget and lateness, arguments of the method -> numbers; what is left, and the ceiling."""
    numbers, of, given = TANK.symbols("numbers"), ca.SX.sym("of", 2), ca.SX.sym("given", 3)
    each = EnergyTank(
        numbers,
        1,
        budget=of[0],
        slew=ca.SX(SLEW),
        speed_cap=ca.SX(CAP),
        late=of[1],
        window=ca.SX(window),
        tail=ca.SX(0),
        dt=ca.SX(DT),
    )
    after = {
        "elapsed": lambda: each.elapsed(given[:2], given[2], given[2]),
        "seen": lambda: each.seen(given[:2]),
        "jumped": lambda: each.jumped(given[0]),
        "nothing": lambda: each,
    }[name]()
    outputs = [after.numbers.column, ca.vertcat(each.left, each.ceiling)]
    return BufferedFunction(ca.Function(name, [numbers.column, of, given], outputs))


class Tank:
    """A tank with numbers in it."""

    def __init__(self, budget: float, late: float) -> None:
        self.of = budget, late
        self.reset()

    def reset(self) -> None:
        self.numbers = TANK.numbers(**dict.fromkeys(TANK.places, 0.0) | {"level": self.of[0]})

    def elapse(self, force_x: float, force_y: float, seconds: float) -> None:
        self.numbers = function("elapsed").of(self.numbers, self.of, (force_x, force_y, seconds))

    def seen(self, dx: float, dy: float) -> None:
        self.numbers = function("seen").of(self.numbers, self.of, (dx, dy, 0.0))

    def jumped(self, distance: float) -> None:
        self.numbers = function("jumped").of(self.numbers, self.of, (distance, 0.0, 0.0))

    @property
    def told(self) -> list[float]:
        nothing = function("nothing")
        nothing.of(self.numbers, self.of, np.zeros(3))
        return nothing.outputs[1].tolist()

    @property
    def left(self) -> float:
        return self.told[0]

    @property
    def ceiling(self) -> float:
        return self.told[1]


def tank(budget: float = 5.0, late: float = LATE) -> Tank:
    return Tank(budget, late)


@settings(max_examples=40, deadline=None)
@given(
    budget=st.floats(0.01, 10.0), dt=st.sampled_from([1e-4, 1e-3, 1e-2]), seed=st.integers(0, 2**32),
    blind=st.floats(0.0, 0.9), late=st.floats(0.0, 0.2),
)  # fmt: skip
def test_no_hand_below_the_cap_draws_more_than_the_budget(
    budget: float, dt: float, seed: int, blind: float, late: float
) -> None:
    each, rng = tank(budget), np.random.default_rng(seed)
    force, delivered, since = np.zeros(2), 0.0, np.zeros(2)
    most = 0.0
    for _ in range(400):
        seconds = LATE if rng.random() < late else dt
        size = np.linalg.norm(force)
        direction = force / size if size and rng.random() < 0.8 else rng.standard_normal(2) / 3
        moved = CAP * seconds * direction / max(1.0, np.linalg.norm(direction))
        each.elapse(*force, seconds)
        delivered += float(force @ moved)
        since = since + moved
        if rng.random() >= blind:
            each.seen(*since)
            since = np.zeros(2)
        most = max(most, delivered)
        # What a controller does: to the ceiling within the slew bound, or at once where that is not enough.
        aim = min(each.ceiling, LIMIT)
        lowest, highest = max(0.0, size - SLEW * dt), size + SLEW * dt
        new = 0.0 if lowest > aim else min(aim, highest)
        turned = force / size if size else np.array([1.0, 0.0])
        force = new * turned
    assert most <= budget + 1e-9
    assert each.left <= budget - delivered + 1e-9 or each.left <= 0.0  # it never thinks that more is left than there is


def test_energy_that_the_hand_puts_in_is_given_back_up_to_the_budget() -> None:
    each = tank()
    each.elapse(10.0, 0.0, DT)
    each.seen(1e-3, 0.0)
    assert each.left == pytest.approx(5.0 - 0.01)
    for _ in range(3):
        each.elapse(10.0, 0.0, DT)
        each.seen(-1e-3, 0.0)
    assert each.left == 5.0


def test_while_nothing_is_seen_the_most_is_set_aside_and_then_settled() -> None:
    each = tank()
    for _ in range(10):
        each.elapse(20.0, 0.0, DT)
    assert each.left == pytest.approx(5.0 - 10 * 20 * CAP * DT)
    each.seen(2e-3, 0.0)
    assert each.left == pytest.approx(5.0 - 20 * 2e-3)


def test_after_a_gap_nothing_is_given_back_beyond_what_was_set_aside() -> None:
    each = tank()
    for _ in range(10):
        each.elapse(20.0, 0.0, DT)
    each.seen(-8e-3, 0.0)
    assert each.left == 5.0
    each.elapse(0.0, 0.0, DT)
    each.jumped(0.05)  # the position that settled the gap was a lie
    assert each.left <= 5.0 - 10 * 20 * CAP * DT


def test_a_jump_costs_what_a_hand_could_have_drawn() -> None:
    each = tank()
    each.elapse(30.0, 0.0, DT)
    each.jumped(0.004)
    assert each.left == pytest.approx(5.0 - 30 * CAP * DT - 30 * 0.004)
    each.reset()
    each.elapse(30.0, 0.0, DT)
    each.jumped(100.0)  # no hand: a sensor's glitch does not end the session
    assert each.left == pytest.approx(5.0 - 30 * CAP * DT - 30 * HAND_SPEED * DT)
