"""A shoulder in a robot's frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt.workspace.placement import ShoulderPlacement
from tests.refusals import refuses

coordinate = st.floats(-10, 10)


@given(coordinate, coordinate, coordinate, st.floats(-10, 10), coordinate, coordinate)
def test_there_and_back_is_where_it_was(x: float, y: float, z: float, turn: float, a: float, b: float) -> None:
    placement = ShoulderPlacement((x, y, z), turn)
    np.testing.assert_allclose(placement.to_shoulder(placement.to_robot((a, b))), (a, b), atol=1e-12)
    homogeneous = placement.pose @ (a, b, 0.0, 1.0)
    np.testing.assert_allclose(homogeneous[:2], placement.to_robot((a, b)), atol=1e-12)
    assert homogeneous[2] == pytest.approx(z)


def test_a_quarter_turn_brings_forward_to_the_left() -> None:
    placement = ShoulderPlacement((1.0, 0.0, 0.0), math.pi / 2)
    np.testing.assert_allclose(placement.to_robot([(0.0, 1.0), (1.0, 0.0)]), [(0.0, 0.0), (1.0, 1.0)], atol=1e-15)


def test_what_is_no_position_and_no_point_is_refused() -> None:
    refuses(
        ShoulderPlacement,
        *(((each,), "position") for each in ("abc", ("1", "2", "3"), {1, 2, 3}, None, 1.0, np.zeros((3, 1)))),
        *(((each,), "position") for each in ((0, 0), (0, 0, math.nan), (0, 0, math.inf))),
    )
    for move in (ShoulderPlacement().to_robot, ShoulderPlacement().to_shoulder):
        refuses(move, *(((each,), "points") for each in ((1, 2, 3), 1.0, "ab", [["1", "2"]], [[1], [1, 2]], None)))
