"""What a user's hand may and may not cause."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt import ConfigurationError, Joystick
from rehab_opt.control.joystick import STICK_MODES, StickMode
from rehab_opt.control.scanning import Scanning

deflections = st.lists(st.floats(-1.5, 1.5), min_size=2, max_size=2).map(np.array)
hostile = st.one_of(st.floats(), st.sampled_from([math.nan, math.inf, -math.inf]))


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


def test_a_caller_may_define_any_pair() -> None:
    stick = let_go(Joystick([StickMode("nod", ("ry", "x"), (0.3, -0.1))]))
    np.testing.assert_allclose(settled(stick, [0.0, 1.0]).twist, [0.0, -0.1])


def test_rows_that_a_mode_holds_are_asked_to_stand_in_the_order_of_all_rows() -> None:
    modes = [StickMode("cup", ("z", "x"), (0.2, 0.1), ("ry", "rx", "y")), StickMode("up", ("y", "z"), (0.1, 0.1))]
    stick = let_go(Joystick(modes))
    command = settled(stick, [1.0, 0.0])
    assert command.rows == ("x", "y", "z", "rx", "ry") == modes[0].task_rows
    np.testing.assert_allclose(command.twist, [0.0, 0.0, 0.2, 0.0, 0.0])
    stick.step([0.0, 0.0], switch=True)
    assert settled(stick, [1.0, 0.0]).rows == ("y", "z")


@pytest.mark.parametrize("held", [("x",), ("w",), ("rx", "rx"), "rx ry", ("rx", "ry", "rz", "roll7"), 3])
def test_rows_that_cannot_be_held_are_refused(held: object) -> None:
    with pytest.raises(ConfigurationError, match=r"modes\[0\].held = "):
        Joystick([StickMode("cup", ("x", "y"), (0.1, 0.1), held)])  # type: ignore[arg-type]


@given(deflections)
def test_tremor_within_the_dead_zone_moves_nothing_and_beyond_it_the_direction_is_kept(axes: np.ndarray) -> None:
    command = settled(let_go(Joystick(dead_zone=0.2)), axes)
    size = np.hypot(*np.clip(axes, -1, 1))
    if size <= 0.2:
        assert not command.twist.any()
    else:
        fraction = np.hypot(*command.twist) / 0.25
        assert fraction == pytest.approx(min((size - 0.2) / 0.8, 1.0), abs=1e-12)
        clipped = np.clip(axes, -1, 1)
        assert abs(command.twist[0] * clipped[1] - command.twist[1] * clipped[0]) < 1e-12


@given(st.lists(deflections, min_size=2, max_size=30))
def test_speed_grows_no_faster_than_the_rate_and_letting_go_is_not_delayed(path: list[np.ndarray]) -> None:
    stick, last = let_go(Joystick(rate=2.0, dt=0.01)), np.zeros(2)
    for axes in path:
        twist = stick.step(axes).twist / 0.25
        if twist.any():
            assert np.linalg.norm(twist - last) <= 0.02 + 1e-12
        last = twist
    assert not stick.step([0.0, 0.0]).twist.any()


def test_a_held_stick_moves_nothing_after_a_change_of_mode_until_it_was_let_go() -> None:
    stick = let_go(Joystick())
    settled(stick, [1.0, 0.0])
    command = settled(stick, [1.0, 0.0], switch=True)
    assert command.rows == ("z", "roll7")
    assert not command.twist.any()
    assert "let go" in command.reason
    let_go(stick)
    assert settled(stick, [1.0, 0.0]).twist.any()


def test_a_stick_that_is_off_its_middle_at_the_beginning_moves_nothing() -> None:
    assert not settled(Joystick(), [0.5, 0.5]).twist.any()


def test_a_press_acts_once_however_long_it_is_and_however_its_contact_bounces() -> None:
    stick = let_go(Joystick(dt=0.01))
    states = [settled(stick, [0, 0], 50, gripper=True).gripper_closed]
    settled(stick, [0, 0], 50)
    states.extend(stick.step([0, 0], gripper=down).gripper_closed for down in (True, False, True, False, True))
    assert states == [True, *[False] * 5]


def test_a_button_that_is_stuck_from_the_beginning_is_not_pressed() -> None:
    assert settled(Joystick(), [0, 0], gripper=True, switch=True).gripper_closed is False


@given(st.lists(hostile, min_size=2, max_size=2), st.lists(hostile, min_size=2, max_size=2))
def test_numbers_never_raise_and_never_leave_the_speeds(first: list[float], second: list[float]) -> None:
    stick = let_go(Joystick())
    for axes in (first, second, [1.0, 0.0]):
        twist = stick.step(axes, switch=axes[0], gripper=axes[1]).twist
        assert np.all(np.isfinite(twist))
        assert not twist.flags.writeable
        assert np.all(np.abs(twist) <= np.abs(stick.mode.speeds) + np.array([1e-12, 1e-12]))


def test_a_stick_that_was_not_a_number_must_be_let_go() -> None:
    stick = let_go(Joystick())
    settled(stick, [1.0, 0.0])
    assert not stick.step([math.nan, 0.0]).twist.any()
    assert not settled(stick, [1.0, 0.0]).twist.any()
    assert settled(let_go(stick), [1.0, 0.0]).twist.any()


def test_one_switch_scans_every_row_both_ways_and_the_gripper() -> None:
    scan = Scanning(dt=0.01, dwell=0.5)
    assert [option.name for option in scan.options] == [
        "x+", "x-", "y+", "y-", "z+", "z-", "roll7+", "roll7-", "gripper",
    ]  # fmt: skip
    lit = []
    for _ in range(450):
        lit.append(scan.lit.name)
        assert not scan.step(0.0).twist.any()
    assert lit == [option.name for option in scan.options for _ in range(50)]


def test_a_press_holds_the_lit_option_and_moves_while_it_lasts() -> None:
    scan = Scanning(dt=0.01, dwell=0.5)
    while scan.lit.name != "y-":
        scan.step(0)
    for _ in range(300):
        command = scan.step(1)
    np.testing.assert_allclose(command.twist, [0.0, -0.25])
    assert command.rows == ("x", "y")
    assert scan.lit.name == "y-"
    assert not scan.step(0).twist.any()


def test_a_puff_moves_one_way_and_a_sip_the_other_and_each_works_the_gripper_once() -> None:
    scan = Scanning(sip=True, dt=0.01, dwell=0.3)
    assert [option.name for option in scan.options] == ["x", "y", "z", "roll7", "gripper"]
    scan.step(0.0)
    for _ in range(100):
        forward = scan.step(0.8)
    for _ in range(100):
        back = scan.step(-0.8)
    np.testing.assert_allclose(forward.twist, [0.25, 0])
    np.testing.assert_allclose(back.twist, [-0.25, 0])
    while scan.lit.name != "gripper":
        scan.step(0.0)
    states = [scan.step(p).gripper_closed for p in (0.9, 0.9, 0.0, -0.9, -0.9, 0.0)]
    assert states == [True, True, True, False, False, False]


def test_a_switch_that_bounces_opens_no_gripper_that_it_has_just_closed() -> None:
    scan = Scanning(sip=True, dt=0.01, dwell=0.3)
    while scan.lit.name != "gripper":
        scan.step(0.0)
    states = [scan.step(p).gripper_closed for p in (0.9, 0.0, 0.9, 0.0, 0.0, 0.9, 0.9)]
    assert states == [True] * 7
    for _ in range(16):
        scan.step(0.0)
    assert scan.lit.name == "gripper"
    assert scan.step(0.9).gripper_closed is False  # a second press


def test_breath_that_wavers_about_the_threshold_is_one_press() -> None:
    scan = Scanning(sip=True, dt=0.01, threshold=0.3, rate=1e3)
    scan.step(0.0)
    assert not scan.step(0.29).twist.any()
    assert scan.step(0.31).twist[0] > 0
    assert scan.step(0.22).twist[0] > 0
    assert not scan.step(0.2).twist.any()
    assert not scan.step(0.22).twist.any()
    assert not scan.step(-0.22).twist.any()
    assert scan.step(-0.31).twist[0] < 0


@pytest.mark.parametrize("pressure", [math.nan, math.inf, None, "x", "1", b"1", 10**400])
def test_what_is_no_pressure_is_no_press(pressure: object) -> None:
    scan = Scanning()
    scan.step(0.0)
    assert not scan.step(pressure).twist.any()  # type: ignore[arg-type]
    assert not scan.step(1.0).twist.any()  # to be let go first


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("dead_zone", 1.0),
        ("dead_zone", math.nan),
        ("rate", 0.0),
        ("dt", -1.0),
        ("modes", []),
        ("modes", [StickMode("a", ("x", "x"), (1, 1))]),
        ("modes", [StickMode("a", ("x", "up"), (1, 1))]),
        ("modes", [StickMode("a", ("x", "y"), (1, math.nan))]),
        ("modes", 5),
        ("modes", None),
        ("modes", [5]),
        ("modes", ["xyz"]),
        ("modes", [("x", "y")]),
        ("modes", StickMode("a", ("x", "y"), (1, 1))),
        ("modes[0].rows", [StickMode("a", None, (1, 1))]),  # type: ignore[arg-type]
        ("modes[0].rows", [StickMode("a", "xy", (1, 1))]),  # type: ignore[arg-type]
        ("modes[0].rows", [StickMode("a", ("x", ["y"]), (1, 1))]),  # type: ignore[arg-type]
        ("modes[0].speeds", [StickMode("a", ("x", "y"), None)]),  # type: ignore[arg-type]
        ("modes[0].speeds", [StickMode("a", ("x", "y"), ("a", "b"))]),  # type: ignore[arg-type]
        ("modes[0].speeds", [StickMode("a", ("x", "y"), (10**400, 1))]),
    ],
)
def test_a_stick_that_cannot_be_is_refused(argument: str, value: object) -> None:
    for device in (Joystick, Scanning):
        if argument not in ("dead_zone",) or device is Joystick:
            with pytest.raises(ConfigurationError, match=re.escape(argument)):
                device(**{argument.partition("[")[0]: value})  # type: ignore[arg-type]


def test_a_mode_given_as_lists_moves_the_resolver_s_rows() -> None:
    stick = let_go(Joystick([("tilt", ["rx", "z"], [0.1, 0.2])]))  # type: ignore[list-item]
    assert stick.step([1.0, 0.0]).rows == ("rx", "z")


def test_a_straw_is_there_or_not() -> None:
    with pytest.raises(ConfigurationError, match="sip"):
        Scanning(sip="no")  # type: ignore[arg-type]


def test_axes_beyond_all_floats_move_nothing() -> None:
    assert not let_go(Joystick()).step([10**400, 0]).twist.any()


@pytest.mark.parametrize("axes", [[0.0], [0, 0, 0], "up", None, ["1", "0"], [b"1", b"0"], [1j, 0]])
def test_axes_of_the_wrong_shape_are_an_error(axes: object) -> None:
    with pytest.raises(ConfigurationError, match="axes"):
        Joystick().step(axes)  # type: ignore[arg-type]
