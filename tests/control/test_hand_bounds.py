"""The rows of the floor and the planes always leave a velocity that accelerations allow."""

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
    braking = ca.fmin(ca.fmax(0, LOWER), UPPER)
    rows, most = feasible_rows(
        GRADIENT, CLIMB, calm=CALM, normals=NORMALS, most=MOST, bounds=bounds, braking=braking, leading=2
    )
    inputs = [GRADIENT, CLIMB, CALM, NORMALS, MOST, LOWER, UPPER]
    outputs = [ca.densify(each) for each in (rows, most)]
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
    rows, most = (output.copy() for output in ROWS.outputs)
    lower, upper = given[5:]
    answer = linprog(np.zeros(N), A_ub=rows, b_ub=most + 1e-9, bounds=list(zip(lower, upper, strict=True)))
    assert answer.status == 0
    # What the floor asks for is asked for in full, as far as accelerations allow it together with the other rows.
    gradient, climb, _, _, others = given[:5]
    fastest = np.where(gradient > 0, upper, lower) @ gradient
    if climb <= min(fastest, 0.0) and np.all(others > 1e3):
        assert -most[0] >= climb - 1e-9
    assert np.all(most[1:] >= others)


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
    rows, bounds = (output.copy() for output in ROWS.outputs)
    answer = linprog(np.zeros(N), A_ub=rows, b_ub=bounds + 1e-9, bounds=list(zip(lower, upper, strict=True)))
    assert answer.status == 0
    braking = np.clip(0, lower, upper)
    # What is not below zero is asked as it was, unless braking breaks it; and nobody is led nearer than by that.
    assert bounds[1] <= max(most[0], normals[0] @ braking) + 1e-12
    assert np.all(bounds[2:] >= most[1:])
    assert np.all(bounds[2:] <= np.maximum(most[1:], np.maximum(normals[1:] @ braking, 0.0)) + 1e-12)
    if alone:
        assert bounds[3] == pytest.approx(most[2], abs=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=200, deadline=None)
def test_the_floor_alone_is_asked_for_as_far_as_accelerations_allow(seed: int) -> None:
    gradient, climb, calm, normals, most, lower, upper = drawn(seed)
    for target, value in zip(ROWS.inputs, (gradient, climb, calm, normals, most + 1e3, lower, upper), strict=True):
        target[...] = value
    ROWS()
    fastest = np.where(gradient > 0, upper, lower) @ gradient
    asked = min(climb, calm, 0.9 * fastest if fastest > 0 else fastest) if climb > 0 else min(climb, fastest)
    assert -ROWS.outputs[1][0] >= asked - 1e-9


@pytest.mark.parametrize(
    ("point", "normal"), [([0, 0], [0, 0, 1]), ([0, 0, 0], [0, 0, 0]), ([np.nan, 0, 0], [0, 0, 1])]
)
def test_what_is_no_plane_is_refused(point: list[float], normal: list[float]) -> None:
    with pytest.raises(ConfigurationError, match="normal"):
        KeepOut.through(point, normal)
