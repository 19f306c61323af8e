"""One tab commands, the others watch; the dead-man is held by heartbeats and by nothing else."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.live.seats import Seats, inputs_of
from rehab_opt.loop.loop import DEAD_MAN
from rehab_opt.session.live.problem import LiveInputs

HELD, LET_GO = LiveInputs(enable=True), LiveInputs()


def page(**changed: Any) -> dict[str, Any]:
    """What the page sends."""
    return {
        "enable": True, "target": None, "push": [0, 0, 0], "stick": [0, 0], "switch": False, "gripper": False,
        "frozen": -1, "noise": 0, "delay": 0,
    } | changed  # fmt: skip


def test_the_first_tab_commands_and_the_next_ones_watch() -> None:
    seats = Seats()
    first, second = seats.join(participant=False), seats.join(participant=False)
    seats.hear(second, HELD, now=1.0)
    assert (seats.commander, seats.current.enable) == (first, False)
    assert seats.state(second) == {"commands": False, "tabs": 2, "participants": 0}


def test_a_tab_that_takes_the_command_begins_released() -> None:
    seats = Seats()
    first, second = seats.join(participant=False), seats.join(participant=False)
    seats.hear(first, HELD, now=1.0)
    seats.take(second)
    assert math.isnan(seats.heartbeat)
    seats.hear(first, HELD, now=1.01)
    assert (seats.commander, seats.current.enable) == (second, False)


def test_a_tab_that_is_gone_holds_nothing() -> None:
    seats = Seats()
    tab = seats.join(participant=False)
    seats.hear(tab, HELD, now=1.0)
    assert seats.heartbeat == 1.0
    seats.leave(tab)
    assert (seats.commander, seats.current.enable, math.isnan(seats.heartbeat)) == (None, False, True)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.001, 0.4), min_size=1, max_size=30))
def test_a_page_that_was_silent_has_to_let_go_before_it_holds_again(gaps: list[float]) -> None:
    seats, now = Seats(), 10.0
    tab, lapsed = seats.join(participant=False), False
    seats.hear(tab, HELD, now=now)
    for gap in gaps:
        before, now = now, now + gap
        lapsed = lapsed or not now - before <= DEAD_MAN
        seats.hear(tab, HELD, now=now)
        assert seats.current.enable is not lapsed
        assert (seats.lapsed != "") is lapsed
        assert math.isnan(seats.heartbeat) is lapsed
    seats.hear(tab, LET_GO, now=now + 1.0)
    seats.hear(tab, HELD, now=now + 2.0)
    assert seats.current.enable


@settings(max_examples=60, deadline=None)
@given(waited=st.floats(0.0, 0.5), ahead=st.floats(0.0, 5.0))
def test_a_heartbeat_is_as_old_as_what_was_sent_however_late_it_is_heard(waited: float, ahead: float) -> None:
    seats = Seats()
    tab = seats.join(participant=False)
    seats.hear(tab, HELD, now=10.0 + waited, sent=10.0)
    late = not 10.0 + waited - 10.0 <= DEAD_MAN
    assert (seats.current.enable, math.isnan(seats.heartbeat)) == (not late, late)
    assert late or seats.heartbeat == 10.0
    seats.hear(tab, LET_GO, now=11.0, sent=11.0)
    seats.hear(tab, HELD, now=12.0, sent=12.0 + ahead)  # a clock that runs ahead makes nothing fresher
    assert seats.heartbeat == 12.0
    seats.hear(tab, HELD, now=12.01, sent=math.nan)
    assert not seats.current.enable


def test_a_participant_never_commands_and_leads_the_hand_only_in_a_tab_of_theirs() -> None:
    seats = Seats()
    theirs = seats.join(participant=True)
    seats.take(theirs)
    seats.hear(theirs, HELD, now=1.0)
    assert (seats.commander, seats.current.enable) == (None, False)
    main = seats.join(participant=False)
    seats.point(main, (1.0, 0.0, 0.0))
    assert not seats.current.dragged
    seats.point(theirs, (0.1, 0.2, 0.0))
    assert seats.current.target == (0.1, 0.2, 0.0)
    seats.point(theirs, None)
    assert not seats.current.dragged


def test_of_two_hands_the_page_leads_the_helper_s_and_the_participant_theirs() -> None:
    seats = Seats(hands=2)
    main, theirs = seats.join(participant=False), seats.join(participant=True)
    seats.hear(main, HELD._replace(target=(0.3, 0.4, 0.0)), now=1.0)
    assert (seats.current.helper, seats.current.dragged) == ((0.3, 0.4, 0.0), False)
    seats.point(theirs, (0.1, 0.2, 0.0))
    assert (seats.current.helper, seats.current.target) == ((0.3, 0.4, 0.0), (0.1, 0.2, 0.0))
    seats.leave(main)
    assert math.isnan(seats.current.helper[0])


def test_what_the_page_sends_is_understood() -> None:
    inputs = inputs_of(
        page(target=[1, 2, 3], push=[1, 0, 0], stick=[0.5, -1], frozen=2, noise=0.001, delay=0.05), joints=6
    )
    assert inputs == LiveInputs(
        enable=True, target=(1.0, 2.0, 3.0), push=(1.0, 0.0, 0.0), stick=(0.5, -1.0), frozen=2, noise=0.001, delay=0.05
    )  # fmt: skip
    assert inputs_of(page(enable=1), joints=6) == LiveInputs()


@pytest.mark.parametrize(
    "wrong",
    [
        {"target": [1, 2]}, {"target": [math.nan, 0, 0]}, {"push": [200, 0, 0]},
        {"stick": [2, 0]}, {"frozen": -2}, {"noise": 1.0}, {"delay": -1}, {"stick": [[0], 0]},
    ],
)  # fmt: skip
def test_inputs_that_cannot_be_are_no_heartbeat(wrong: dict[str, Any]) -> None:
    assert inputs_of(page(**wrong), joints=6) is None


values = st.none() | st.booleans() | st.floats() | st.just("text") | st.lists(st.floats() | st.none(), max_size=4)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(page())), values))
def test_no_message_breaks_the_server(changed: dict[str, Any]) -> None:
    inputs = inputs_of(page(**changed), joints=6)
    assert inputs is None or all(map(math.isfinite, (*inputs.push, *inputs.stick, inputs.noise, inputs.delay)))


def test_a_tab_that_sends_too_much_has_let_go() -> None:
    """What waits to be read would hold the dead-man for seconds after it was released."""
    seats = Seats()
    tab = seats.join(participant=False)
    for i in range(5000):
        seats.hear(tab, HELD, now=1.0 + 1e-4 * i)
    assert not seats.current.enable
    assert math.isnan(seats.heartbeat)
    assert "too much" in seats.lapsed
    seats.hear(tab, LET_GO, now=2.0)
    seats.hear(tab, HELD, now=2.025)
    assert seats.current.enable
