"""Claims about the energy tank: nobody draws more than the budget, whatever is seen of the hand."""

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.control.energy_tank import SLOTS, EnergyTank, tank_record
from rehab_opt.field.samples import HAND_SPEED
from rehab_opt.symbolic import BufferedFunction

SLEW, CAP, DT, LATE, LIMIT = 200.0, 1.0, 1e-3, 0.05, 30.0
WINDOW = 0.04
"""[s] in which forces act where they act late, in pieces of 5 ms."""


@cache
def function(name: str, window: float) -> BufferedFunction:
    """Numbers of the tank, budget and lateness, arguments of the method -> numbers; what is left, and the ceiling."""
    slots = SLOTS if window else 1
    numbers, of, given = tank_record(slots).symbols("numbers"), ca.SX.sym("of", 2), ca.SX.sym("given", 3)
    each = EnergyTank(
        numbers,
        slots,
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

    def __init__(self, budget: float, late: float, window: float) -> None:
        self.of, self.window = (budget, late), window
        self.reset()

    def reset(self) -> None:
        record = tank_record(SLOTS if self.window else 1)
        self.numbers = record.numbers(**dict.fromkeys(record.places, 0.0) | {"level": self.of[0]})

    def elapse(self, force_x: float, force_y: float, seconds: float) -> None:
        self.numbers = function("elapsed", self.window).of(self.numbers, self.of, (force_x, force_y, seconds))

    def seen(self, dx: float, dy: float) -> None:
        self.numbers = function("seen", self.window).of(self.numbers, self.of, (dx, dy, 0.0))

    def jumped(self, distance: float) -> None:
        self.numbers = function("jumped", self.window).of(self.numbers, self.of, (distance, 0.0, 0.0))

    @property
    def told(self) -> list[float]:
        nothing = function("nothing", self.window)
        nothing.of(self.numbers, self.of, np.zeros(3))
        return nothing.outputs[1].tolist()

    @property
    def left(self) -> float:
        return self.told[0]

    @property
    def ceiling(self) -> float:
        return self.told[1]


def tank(budget: float = 5.0, late: float = LATE, window: float = 0.0) -> Tank:
    return Tank(budget, late, window)


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


# --------------------------------------------------------------------------------------------- forces that act late
def turned() -> Tank:
    """A tank of 5 J behind 5 ms of (1, 0) N and 5 ms of a force that turned from (6, 0) to (0, 8) N: 10 N apart."""
    each = tank(window=WINDOW)
    for force in [(1.0, 0.0)] * 5 + [(6.0, 0.0)] + [(0.0, 8.0)] * 4:
        each.elapse(*force, DT)
        each.seen(0.0, 0.0)
    assert each.left == 5.0
    return each


def test_a_step_is_charged_with_the_most_that_a_force_near_the_first_of_a_piece_delivers() -> None:
    """(6, 0) N and all within 10 N of it: (6 * 0 + 10 |dx|) for a step across."""
    each = turned()
    each.seen(0.0, 1e-3)
    assert each.left == pytest.approx(5.0 - 10e-3, abs=1e-12)
    each.seen(1e-3, 0.0)
    assert each.left == pytest.approx(5.0 - 10e-3 - 16e-3, abs=1e-12)
    each.seen(-1e-3, 0.0)  # (-6 + 10) mm N: what the hand put in is given back only where every force got it
    assert each.left == pytest.approx(5.0 - 10e-3 - 16e-3 - 4e-3, abs=1e-12)


def test_an_unseen_hand_has_the_largest_force_under_way_set_aside() -> None:
    """6 + 10 N on CAP for a tick, and as much per metre of a jump."""
    each = turned()
    each.elapse(0.0, 8.0, DT)
    assert each.left == pytest.approx(5.0 - 16e-3, abs=1e-12)
    each.jumped(1e-3)
    assert each.left == pytest.approx(5.0 - 16e-3 - 16e-3, abs=1e-12)


def test_hidden_motion_is_charged_with_the_first_force_and_what_others_could_have_added() -> None:
    """Two ticks of (0, 8) N, beside which 10 + 10 N were under way: -8 * 2 mm + 20 N on CAP for 2 ms."""
    each = turned()
    for _ in range(2):
        each.elapse(0.0, 8.0, DT)
    each.seen(0.0, -2e-3)
    assert each.left == pytest.approx(5.0 - 24e-3, abs=1e-12)


def test_the_ceiling_leaves_what_forces_under_way_can_still_deliver() -> None:
    """The piece that turned ended 43 of 40 + 5 ms ago: 2 ms of 6 + 10 N, less than its impulse of 38 mN s."""
    each = turned()
    assert each.ceiling == pytest.approx(math.sqrt(10.0**2 + 2 * SLEW * (5.0 - 5e-3 - 38e-3)) - 10.0, abs=1e-9)
    for _ in range(43):
        each.elapse(0.0, 0.0, DT)
        each.seen(0.0, 0.0)
    assert each.ceiling == pytest.approx(math.sqrt(10.0**2 + 2 * SLEW * (5.0 - 32e-3)) - 10.0, abs=1e-6)
