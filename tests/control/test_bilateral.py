"""Claims about helper and participant at one task."""

from __future__ import annotations

import math
from functools import cache, partial

import numpy as np
import pytest

from rehab_opt import ConfigurationError, Status
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant, HelperSide, ParticipantSide
from rehab_opt.control.force_tick import LEAP, hear
from rehab_opt.workspace.controller_map import ControllerMap
from tests.refusals import refuses
from tests.workspace.mapped import mapped, shape

DT, BUDGET, LIMIT, SLEW = 1e-3, 2.0, 20.0, 400.0
BOUNDS = {
    "dt": DT, "energy_budget": BUDGET, "slew_limit": SLEW, "force_limit": LIMIT, "trust_stillness": True,
    "compile": False,
}  # fmt: skip
HELPER = np.array([-0.17, 0.49])  # inside the regular workspace


@cache
def workspace_map() -> ControllerMap:
    return mapped("regular", "restricted").for_controller()


def pair(*, delay: float = 0.0, helper: dict[str, float] | None = None, **participant: float) -> Bilateral:
    return Bilateral(
        HelperSide(workspace_map(), **{**BOUNDS, **(helper or {})}),  # type: ignore[arg-type]
        ParticipantSide(workspace_map(), comfortable=shape("restricted"), **{**BOUNDS, **participant}),  # type: ignore[arg-type]
        delay=delay,
    )


def test_what_the_helper_puts_in_moves_the_participant_beyond_their_own_tank() -> None:
    """The participant's arm is heavy: each round costs energy, which the helper delivers."""

    def delivered(exchange: float) -> float:
        budget = {"energy_budget": 0.3}
        both = pair(helper={"exchange": exchange, **budget}, exchange=exchange, stiffness=2000.0, damping=0.0, **budget)
        participant, total = workspace_map().image(HELPER), 0.0
        for k in range(7_000):
            angle = 2 * math.pi * k * DT / 2.0
            helper = HELPER + [0.10 * math.sin(angle), 0.03 * math.sin(2 * angle)]
            force = both.step(helper, participant).participant.value
            step = force * DT / 150.0  # viscous: 150 N s/m
            total += force @ step
            participant = participant + step
            if total > 0.5:  # it takes nothing back
                break
        return total

    assert delivered(0.0) <= 0.3 + 1e-9
    assert delivered(20.0) > 0.5


@pytest.mark.parametrize("outside", [np.array([-0.6, 0.9])])
def test_a_side_that_hears_nothing_exerts_no_force_inside_nor_outside_its_workspace(outside: np.ndarray) -> None:
    both = pair()
    for _ in range(300):
        before = math.hypot(*both.step(HELPER, outside).participant.value)
    helper, participant = both.helper, both.participant
    assert before == pytest.approx(10.0)
    for k in range(1, 200):
        led, _ = participant.step(outside, None)
        assert math.hypot(*led.value) <= max(before - 0.99 * SLEW * DT * k, 0.0)
    assert led.status is Status.RELEASED
    for received in (None, FromParticipant(0.0, 0.0, math.nan, 0.0, 0.0, 10_000)):
        for _ in range(100):
            felt, _ = helper.step(np.array([-1.0, 1.0]), received)
        assert not felt.value.any()
    for k in range(50):
        felt, _ = helper.step(np.array([-1.0, 1.0]), FromParticipant(0.0, 0.0, 0.0, 0.0, 0.0, 20_000 + k))
    assert 5.0 < math.hypot(*felt.value) <= 10.0 + 1e-6


def test_the_helper_sees_the_participant_in_their_own_workspace() -> None:
    both, there = pair(), workspace_map().image(HELPER) + [0.003, -0.002]
    for _ in range(3):
        both.step(HELPER, there)
    np.testing.assert_allclose(workspace_map().image(both.helper.partner), there, atol=1e-9)
    both.reset()
    assert np.isnan(both.helper.partner).all()


def sides(budget: float, **participant: float) -> tuple[HelperSide, ParticipantSide]:
    bounds = {**BOUNDS, "energy_budget": budget}
    return (
        HelperSide(workspace_map(), exchange=50.0, **bounds),  # type: ignore[arg-type]
        ParticipantSide(workspace_map(), comfortable=shape("restricted"), exchange=50.0, **{**bounds, **participant}),  # type: ignore[arg-type]
    )


def test_a_side_that_has_missed_many_messages_hears_the_second_again_and_nothing_counts_twice() -> None:
    _, two = sides(1.0)
    at = workspace_map().image(HELPER) + [0.01, 0.0]
    for first, lost in ((1, 0), (10**6, 1), (10**6 + LEAP, 0), (10**9, 1)):
        two.force.give_energy(1.0)
        for k in range(20):
            left = two.force.energy_left
            command, _ = two.step(at, FromHelper(*HELPER, 0.01, first + k))
            taken = k >= lost
            assert (command.status is Status.OK) == taken
            assert (two.force.energy_left > left) == taken
        for k in range(20):  # and none of them again, in turn
            left = two.force.energy_left
            command, _ = two.step(at, FromHelper(*HELPER, 0.01, first + k))
            assert command.status is not Status.OK
            assert two.force.energy_left <= left


@pytest.mark.parametrize("place", [1e6, -1e6, math.nan, 1e300])
def test_a_message_of_a_place_where_no_hand_can_be_says_none(place: float) -> None:
    told = hear(1)(0, 0, 0, [0.0, 1.0, 0.0, place])[2]  # energy, serial, place
    assert np.isnan(np.array(told)).all()
    assert np.array(hear(1)(0, 0, 0, [0.0, 1.0, 0.0, 0.999e6])[2]).tolist() == [[0.0], [0.999e6]]


@pytest.mark.parametrize(
    "wrong", [{"helper": "abc"}, {"participant": [0.1]}, {"helper_velocity": [1, 2, 3]}, {"participant_velocity": 1j}]
)
def test_an_argument_that_is_refused_moves_nothing_on(wrong: dict[str, object]) -> None:
    both, other, rng = pair(delay=0.003), pair(delay=0.003), np.random.default_rng(8)
    hand = np.array([-0.17, 0.49])
    for k in range(40):
        said = {"helper": hand + 1e-4 * rng.standard_normal(2), "participant": workspace_map().image(hand)}
        if k % 3 == 0:
            with pytest.raises(ConfigurationError, match=next(iter(wrong))):
                both.step(**(said | wrong))  # type: ignore[arg-type]
        one, two = both.step(**said), other.step(**said)
        assert both.under_way == other.under_way
        np.testing.assert_array_equal(
            [one.helper.value, one.participant.value], [two.helper.value, two.participant.value]
        )


def test_bad_configuration_is_named() -> None:
    refuses(HelperSide, (("map",), "workspace_map"))
    refuses(
        partial(ParticipantSide, workspace_map(), comfortable=shape("restricted")), ({"stiffness": -1.0}, "stiffness")
    )
    refuses(Bilateral, ((None, None), "helper"), ((sides(BUDGET)[0], sides(BUDGET)[0]), "participant"))
    refuses(pair, ({"delay": math.nan}, "delay"), ({"dt": 0.002}, "tick"))
    side = ParticipantSide(workspace_map(), comfortable=shape("restricted"), **BOUNDS)  # type: ignore[arg-type]
    refuses(side.force.give_energy, *(((fraction,), "fraction") for fraction in ("x", None, math.nan, -0.5)))
    assert side.force.give_energy(2.0) == BUDGET  # all of it, no more
    assert side.force.energy_left == 0.0
