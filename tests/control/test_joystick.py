"""What a user's hand may and may not cause."""

import math
from typing import Any

import numpy as np
import pytest

from rehab_opt import Joystick
from rehab_opt.control.joystick import STICK_MODES, StickMode
from rehab_opt.control.scanning import Scanning
from tests.refusals import refuses


def let_go(stick: Joystick) -> Joystick:
    stick.step([0.0, 0.0])
    return stick


def settled(stick: Joystick, axes: object, ticks: int = 200, **buttons: object):  # type: ignore[no-untyped-def]
    for _ in range(ticks):
        command = stick.step(axes, **buttons)  # type: ignore[arg-type]
    return command


def test_the_paper_s_two_modes_move_x_y_and_then_z_and_the_wrist() -> None:
    stick = let_go(Joystick())
    command = settled(stick, [1.0, 0.0])
    assert command.rows == ("x", "y")
    assert command.frame == "chassis"
    np.testing.assert_allclose(command.twist, [0.25, 0.0])
    stick.step([0.0, 0.0], switch=True)
    command = settled(stick, [0.0, -1.0])
    assert command.rows == ("z", "roll7")
    np.testing.assert_allclose(command.twist, [0.0, -0.6])
    stick.step([0.0, 0.0], switch=True)
    assert stick.mode == STICK_MODES[0]


def test_rows_that_a_mode_holds_are_asked_to_stand_in_the_order_of_all_rows() -> None:
    modes = [StickMode("cup", ("z", "x"), (0.2, 0.1), ("ry", "rx", "y")), StickMode("up", ("y", "z"), (0.1, 0.1))]
    stick = let_go(Joystick(modes))
    command = settled(stick, [1.0, 0.0])
    assert command.rows == ("x", "y", "z", "rx", "ry") == modes[0].task_rows
    np.testing.assert_allclose(command.twist, [0.0, 0.0, 0.2, 0.0, 0.0])
    stick.step([0.0, 0.0], switch=True)
    assert settled(stick, [1.0, 0.0]).rows == ("y", "z")


def test_a_button_that_is_stuck_from_the_beginning_is_not_pressed() -> None:
    assert settled(Joystick(), [0, 0], gripper=True, switch=True).gripper_closed is False


@pytest.mark.parametrize("pressure", [math.nan, None, "1", 10**400])
def test_what_is_no_pressure_is_no_press(pressure: object) -> None:
    scan = Scanning()
    scan.step(0.0)
    assert not scan.step(pressure).twist.any()  # type: ignore[arg-type]
    assert not scan.step(1.0).twist.any()  # to be let go first


def test_what_cannot_be_used_is_named() -> None:
    modes: list[tuple[str, Any]] = [
        *(("modes", value) for value in ([], 5, None, [5], ["xyz"], [("x", "y")], StickMode("a", ("x", "y"), (1, 1)))),
        *(("modes", [StickMode("a", rows, (1, 1))]) for rows in (("x", "x"), ("x", "up"))),
        ("modes", [StickMode("a", ("x", "y"), (1, 1)), StickMode("a", ("z", "rx"), (1, 1))]),
        *(("modes[0].rows", [StickMode("a", rows, (1, 1))]) for rows in (None, "xy", ("x", ["y"]))),  # type: ignore[arg-type]
        *(
            ("modes[0].speeds", [StickMode("a", ("x", "y"), speeds)])
            for speeds in (None, ("a", "b"), (10**400, 1), (1, math.nan))
        ),
        *(
            ("modes[0].held = ", [StickMode("cup", ("x", "y"), (0.1, 0.1), held)])
            for held in (("x",), ("w",), ("rx", "rx"), "rx ry", ("rx", "ry", "rz", "roll7"), 3)
        ),
    ]
    numbers = ({"rate": 0.0}, "rate"), ({"dt": -1.0}, "dt")
    for device in (Joystick, Scanning):
        refuses(device, *numbers, *(({"modes": value}, words) for words, value in modes))
    refuses(Joystick, ({"dead_zone": 1.0}, "dead_zone"), ({"dead_zone": math.nan}, "dead_zone"))
    refuses(Scanning, ({"sip": "no"}, "sip"))
    axes: list[Any] = [[0.0], [0, 0, 0], "up", None, ["1", "0"], [b"1", b"0"], [1j, 0]]
    refuses(Joystick().step, *(((each,), "axes") for each in axes))
    assert not let_go(Joystick()).step([10**400, 0]).twist.any()
