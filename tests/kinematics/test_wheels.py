"""Wheels against rolling written down by hand: which wheel turns which way, and the traps of Eq. (2)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt import ConfigurationError
from rehab_opt.kinematics.drive import Differential, Mecanum

MECANUM = Mecanum(radius=0.1, half_gauge=0.28, half_base=0.25, limit=10.0)
DIFFERENTIAL = Differential(radius=0.15, half_gauge=0.28, limit=7.0)
# Contact points and the direction across the rollers that touch the floor, x forward, y left: in the X arrangement,
# seen from above, the rollers' axes point at the middle, so each wheel pushes along its diagonal.
PLACES = np.array([[0.25, -0.28], [0.25, 0.28], [-0.25, 0.28], [-0.25, -0.28]])
ACROSS = np.array([[1, 1], [1, -1], [1, 1], [1, -1]]) / np.sqrt(2)
twists = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def rolled(twist: np.ndarray) -> np.ndarray:
    """Speeds at which no roller is dragged along its axle: the rim and the floor agree in the wheel's diagonal."""
    speeds = []
    for place, diagonal in zip(PLACES, ACROSS, strict=True):
        floor = twist[:2] + twist[2] * np.array([-place[1], place[0]])
        speeds.append(floor @ diagonal / (diagonal[0] * MECANUM.radius))
    return np.array(speeds)


@given(twists)
def test_mecanum_speeds_are_those_at_which_no_roller_is_dragged(twist: np.ndarray) -> None:
    np.testing.assert_allclose(MECANUM.wheel_speeds(twist), rolled(twist), atol=1e-9)


@given(twists)
def test_mecanum_speeds_and_chassis_motion_are_inverse_and_without_slip(twist: np.ndarray) -> None:
    motion = MECANUM.motion(MECANUM.wheel_speeds(twist))
    np.testing.assert_allclose(motion.twist, twist, atol=1e-12)
    assert motion.slip < 1e-12


@given(twists, st.floats(-5, 5))
def test_wheels_that_work_against_each_other_slip_and_move_nothing(twist: np.ndarray, against: float) -> None:
    motion = MECANUM.motion(MECANUM.wheel_speeds(twist) + against * np.array([1, 1, -1, -1]))
    np.testing.assert_allclose(motion.twist, twist, atol=1e-12)
    assert motion.slip == pytest.approx(abs(against) * MECANUM.radius, abs=1e-12)


@given(twists)
def test_differential_wheels_and_motion_are_inverse_where_nothing_moves_sideways(twist: np.ndarray) -> None:
    twist[1] = 0.0
    motion = DIFFERENTIAL.motion(DIFFERENTIAL.wheel_speeds(twist))
    np.testing.assert_allclose(motion.twist, twist, atol=1e-12)
    assert DIFFERENTIAL.slip(twist) == 0.0


@given(st.floats(-7, 7), st.floats(-1, 1), st.floats(-1, 1))
def test_the_rolling_row_of_eq_4_is_minus_the_speed_to_the_left(heading: float, forward: float, left: float) -> None:
    cos, sin = np.cos(heading), np.sin(heading)
    velocity = np.array([cos * forward - sin * left, sin * forward + cos * left, 0.3, 1, 2, 3, 4])
    row = DIFFERENTIAL.constraints([5.0, 6.0, heading, 0, 0, 0, 0])[0]
    assert row @ velocity == pytest.approx(-left, abs=1e-12)


@pytest.mark.parametrize("number", [0.0, -1.0, np.nan, np.inf, "1"])
def test_wheels_of_no_size_are_refused(number: object) -> None:
    with pytest.raises(ConfigurationError, match="radius"):
        Mecanum(radius=number, half_gauge=0.28, half_base=0.25, limit=10.0)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="limit"):
        Differential(radius=0.1, half_gauge=0.28, limit=number)  # type: ignore[arg-type]
