"""Buffers belong to one object, and what is handed out stays what it was."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt.symbolic import BufferedFunction

numbers = st.floats(-1e6, 1e6)


def product(rows: int, inner: int, columns: int) -> ca.Function:
    left, right = ca.SX.sym("left", rows, inner), ca.SX.sym("right", inner, columns)
    return ca.Function("product", [left, right], [ca.densify(left @ right), ca.densify(left.T)])


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_matrices_go_in_and_come_out_as_numpy_has_them(rows: int, inner: int, columns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = rng.normal(size=(rows, inner)), rng.normal(size=(inner, columns))
    function = BufferedFunction(product(rows, inner, columns))
    function.inputs[0][...] = left.reshape(function.inputs[0].shape)
    function.inputs[1][...] = right.reshape(function.inputs[1].shape)
    function()
    np.testing.assert_allclose(function.outputs[0].reshape(rows, columns), left @ right, atol=1e-12)
    np.testing.assert_array_equal(function.outputs[1].reshape(inner, rows), left.T)


def test_what_of_returns_is_a_copy() -> None:
    function = BufferedFunction(product(2, 2, 1))
    first = function.of(np.eye(2), [1.0, 2.0])
    function.of(np.eye(2), [3.0, 4.0])
    assert first.tolist() == [1.0, 2.0]
    first[:] = 9.0
    assert function.outputs[0].tolist() == [3.0, 4.0]


def test_two_objects_of_one_function_do_not_share_buffers() -> None:
    function = product(2, 2, 1)
    one, other = BufferedFunction(function), BufferedFunction(function)
    one.inputs[0][...], one.inputs[1][...] = np.eye(2), [1.0, 2.0]
    other.inputs[0][...], other.inputs[1][...] = 10 * np.eye(2), [3.0, 4.0]
    one()
    other()
    assert one.outputs[0].tolist() == [1.0, 2.0]
    assert other.outputs[0].tolist() == [30.0, 40.0]
    for mine in (*one.inputs, *one.outputs):
        assert not any(np.shares_memory(mine, theirs) for theirs in (*other.inputs, *other.outputs))


def test_evaluating_without_the_layer_of_python_does_the_same() -> None:
    function = BufferedFunction(product(2, 2, 1))
    function.inputs[0][...], function.inputs[1][...] = np.eye(2), [5.0, 6.0]
    function.evaluate()
    assert function.outputs[0].tolist() == [5.0, 6.0]


def test_empty_inputs_and_outputs_are_arrays_of_no_length() -> None:
    x, nothing = ca.SX.sym("x", 2), ca.SX.sym("nothing", 0)
    function = BufferedFunction(ca.Function("f", [x, nothing], [nothing, x + 1]))
    function.inputs[0][:] = 1.0
    function()
    assert function.inputs[1].size == function.outputs[0].size == 0
    assert function.outputs[1].tolist() == [2.0, 2.0]


def test_a_sparse_argument_is_refused() -> None:
    x = ca.SX.sym("x", 2)
    with pytest.raises(ValueError, match="dense"):
        BufferedFunction(ca.Function("sparse", [x], [ca.diag(x)]))
