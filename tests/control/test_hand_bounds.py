"""The rows of the floor and the planes always leave a velocity, and acceleration yields only where it must."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from rehab_opt import ConfigurationError, KeepOut
from rehab_opt.control.hand_bounds import feasible_rows
from rehab_opt.control.stopping import VelocityBounds
from rehab_opt.symbolic import BufferedFunction

N, M = 6, 3
GRADIENT, NORMALS, MOST = ca.SX.sym("g", N), ca.SX.sym("a", M, N), ca.SX.sym("r", M)
CLIMB, CALM, LOWER, UPPER = ca.SX.sym("f"), ca.SX.sym("c"), ca.SX.sym("l", N), ca.SX.sym("u", N)


def function() -> BufferedFunction:
    nothing = ca.SX.zeros(N)
    bounds = VelocityBounds(LOWER, UPPER, *[nothing] * 4, ca.SX(0), nothing, nothing)
    rows, most, opened = feasible_rows(
        GRADIENT, CLIMB, calm=CALM, normals=NORMALS, most=MOST, bounds=bounds, hard=ca.SX.inf(2)
    )
    inputs = [GRADIENT, CLIMB, CALM, NORMALS, MOST, LOWER, UPPER]
    outputs = [ca.densify(each) for each in (rows, most, opened.lower, opened.upper)]
    return BufferedFunction(ca.Function("rows", inputs, outputs))


ROWS = function()


def drawn(seed: int) -> tuple[np.ndarray, ...]:
    """Gradient, climb, calm, normals, most, lower and upper: at rest, moving, with no room left."""
    rng = np.random.default_rng(seed)
    centre = rng.standard_normal(N) * rng.choice([0.0, 0.3, 1.0])
    half = rng.uniform(0, 0.1, N) * rng.choice([0.0, 1.0, 10.0])
    gradient = rng.standard_normal(N) * rng.choice([0.0, 1e-3, 1.0])
    most = np.maximum(rng.standard_normal(M), 0.0) * rng.choice([0.01, 1.0])
    climb = rng.standard_normal() * rng.choice([0.0, 0.1, 5.0])
    calm = np.abs(gradient).sum() * 0.3
    return gradient, climb, calm, rng.standard_normal((M, N)), most, centre - half, centre + half


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=300, deadline=None)
def test_some_velocity_keeps_every_row_whatever_the_state(seed: int) -> None:
    given = drawn(seed)
    for target, value in zip(ROWS.inputs, given, strict=True):
        target[...] = value
    ROWS()
    rows, most, lower, upper = (output.copy() for output in ROWS.outputs)
    answer = linprog(np.zeros(N), A_ub=rows, b_ub=most + 1e-9, bounds=list(zip(lower, upper, strict=True)))
    assert answer.status == 0
    # The intervals are opened towards rest only, so that no other bound of the joints is touched.
    assert np.all(lower <= given[5] + 1e-15)
    assert np.all(upper >= given[6] - 1e-15)
    assert np.all(lower >= np.minimum(given[5], 0) - 1e-12)
    assert np.all(upper <= np.maximum(given[6], 0) + 1e-12)
    # What the floor asks for while above it is asked for in full.
    if given[1] <= 0:
        assert -most[0] >= given[1] - 1e-9


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=300, deadline=None)
def test_rows_that_lead_away_leave_a_velocity_and_ask_for_all_there_is_room_for(seed: int) -> None:
    gradient, climb, calm, normals, most, lower, upper = drawn(seed)
    rng = np.random.default_rng(seed + 1)
    alone, push = bool(rng.random() < 0.5), rng.uniform(0, 1, 2) * rng.choice([1e-6, 1e-3, 0.1])
    most[1:] = [100.0, -push[1]] if alone else -push
    if alone:  # with room for it
        lower, upper, most[0], climb = np.full(N, -2.0), np.full(N, 2.0), 100.0, min(climb, -100.0)
        normals[2] *= max(1.0, 1 / np.linalg.norm(normals[2]))
    given = gradient, climb, calm, normals, most, lower, upper
    for target, value in zip(ROWS.inputs, given, strict=True):
        target[...] = value
    ROWS()
    rows, bounds, low, high = (output.copy() for output in ROWS.outputs)
    answer = linprog(np.zeros(N), A_ub=rows, b_ub=bounds + 1e-9, bounds=list(zip(low, high, strict=True)))
    assert answer.status == 0
    assert np.all(low >= np.minimum(lower, 0) - 1e-12)
    assert np.all(high <= np.maximum(upper, 0) + 1e-12)
    assert bounds[1] == most[0]  # what is not below zero is asked as it was
    assert np.all(bounds[2:] >= most[1:])
    assert np.all(bounds[2:][most[1:] <= 0] <= 1e-12)  # and nobody is led nearer
    if alone:
        assert bounds[3] == pytest.approx(most[2], abs=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=200, deadline=None)
def test_for_the_floor_alone_the_intervals_open_only_where_they_must(seed: int) -> None:
    gradient, climb, calm, normals, most, lower, upper = drawn(seed)
    for target, value in zip(ROWS.inputs, (gradient, climb, calm, normals, most + 1e3, lower, upper), strict=True):
        target[...] = value
    ROWS()
    opened = np.any(ROWS.outputs[2] < lower - 1e-12) or np.any(ROWS.outputs[3] > upper + 1e-12)
    fastest = np.where(gradient > 0, upper, lower) @ gradient
    if opened:
        assert fastest < min(climb, 0.0) + 1e-12 or fastest < 0.0


@pytest.mark.parametrize(
    ("point", "normal"), [([0, 0], [0, 0, 1]), ([0, 0, 0], [0, 0, 0]), ([np.nan, 0, 0], [0, 0, 1])]
)
def test_what_is_no_plane_is_refused(point: list[float], normal: list[float]) -> None:
    with pytest.raises(ConfigurationError, match="normal"):
        KeepOut.through(point, normal)
