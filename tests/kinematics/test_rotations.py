"""The pose error's rotation vector against scipy, from no rotation to half a turn."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rehab_opt.kinematics.rigid import is_rotation, rotation_vector
from rehab_opt.symbolic import BufferedFunction
from tests.kinematics.dh_oracle import Array

R = ca.SX.sym("R", 3, 3)
VECTOR = BufferedFunction(ca.Function("vector", [R], [ca.densify(rotation_vector(R))]))
PROPER = BufferedFunction(ca.Function("proper", [R], [ca.densify(is_rotation(R))]))

directions = (
    st.lists(st.floats(-1, 1), min_size=3, max_size=3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 1e-3)
    .map(lambda v: v / np.linalg.norm(v))
)
axes = st.one_of(directions, st.sampled_from([*np.eye(3), *-np.eye(3)]))
turns = st.one_of(
    st.floats(0, np.pi),
    st.floats(0, 1e-6),
    st.floats(0, 1e-6).map(lambda gap: np.pi - gap),
    st.sampled_from([0.0, 1e-200, 2 * np.pi / 3, np.pi / 2, np.pi]),
)


@given(axes, turns)
def test_the_vector_turns_by_its_length_about_itself(axis: Array, angle: float) -> None:
    matrix = Rotation.from_rotvec(angle * axis).as_matrix()
    vector = VECTOR.of(matrix)
    assert np.linalg.norm(vector) == pytest.approx(angle, abs=1e-9)
    np.testing.assert_allclose(Rotation.from_rotvec(vector).as_matrix(), matrix, atol=1e-9)
    if angle < np.pi - 1e-6:  # at half a turn both directions are right
        np.testing.assert_allclose(vector, angle * axis, atol=1e-9)


@given(axes, st.floats(1e-12, 1e-7))
def test_a_small_turn_keeps_its_relative_accuracy(axis: Array, angle: float) -> None:
    x, y, z = angle * axis
    matrix = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
    np.testing.assert_allclose(VECTOR.of(matrix), angle * axis, rtol=1e-9, atol=1e-9 * angle)


@given(axes, turns, st.integers(0, 2), st.integers(0, 2))
def test_a_rounded_matrix_is_a_rotation_and_a_mirrored_scaled_or_nan_one_is_none(
    axis: Array, angle: float, row: int, column: int
) -> None:
    matrix = Rotation.from_rotvec(angle * axis).as_matrix()
    for whole in (matrix, matrix.round(4)):
        assert PROPER.of(whole)[0] == 1
    holed = matrix.copy()
    holed[row, column] = np.nan
    for broken in (-matrix, matrix * np.array([1, 1, -1]), 1.01 * matrix, np.zeros((3, 3)), holed):
        assert PROPER.of(broken)[0] == 0
