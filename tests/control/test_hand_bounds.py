"""The rows of the floor and the planes always leave a velocity that accelerations allow."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from rehab_opt import KeepOut, ur5
from rehab_opt.control.hand_bounds import HandBounds, feasible_rows
from rehab_opt.control.stopping import VelocityBounds
from rehab_opt.symbolic import BufferedFunction
from tests.refusals import refuses

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
    """Gradient, ascent, calm, normals, most, lower and upper: at rest, moving, with no room left."""
    rng = np.random.default_rng(seed)
    centre = rng.standard_normal(N) * rng.choice([0.0, 0.3, 1.0])
    half = rng.uniform(0, 0.1, N) * rng.choice([0.0, 1.0, 10.0])
    gradient = rng.standard_normal(N) * rng.choice([0.0, 1e-3, 1.0])
    most = np.maximum(rng.standard_normal(M), 0.0) * rng.choice([0.01, 1.0])
    ascent = rng.standard_normal() * rng.choice([0.0, 0.1, 5.0])
    calm = np.abs(gradient).sum() * 0.3
    return gradient, ascent, calm, rng.standard_normal((M, N)), most, centre - half, centre + half


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
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
    gradient, ascent, _, _, others = given[:5]
    fastest = np.where(gradient > 0, upper, lower) @ gradient
    if ascent <= min(fastest, 0.0) and np.all(others > 1e3):
        assert -most[0] >= ascent - 1e-9
    assert np.all(most[1:] >= others)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_rows_that_lead_away_leave_a_velocity_and_ask_for_all_there_is_room_for(seed: int) -> None:
    gradient, ascent, calm, normals, most, lower, upper = drawn(seed)
    rng = np.random.default_rng(seed + 1)
    alone, push = bool(rng.random() < 0.5), rng.uniform(0, 1, 2) * rng.choice([1e-6, 1e-3, 0.1])
    most[1:] = [100.0, -push[1]] if alone else -push
    if alone:  # with room for it
        lower, upper, most[0], ascent = np.full(N, -2.0), np.full(N, 2.0), 100.0, min(ascent, -100.0)
        normals[2] *= max(1.0, 1 / np.linalg.norm(normals[2]))
    given = gradient, ascent, calm, normals, most, lower, upper
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
@settings(max_examples=80, deadline=None)
def test_the_floor_alone_is_asked_for_as_far_as_accelerations_allow(seed: int) -> None:
    gradient, ascent, calm, normals, most, lower, upper = drawn(seed)
    for target, value in zip(ROWS.inputs, (gradient, ascent, calm, normals, most + 1e3, lower, upper), strict=True):
        target[...] = value
    ROWS()
    fastest = np.where(gradient > 0, upper, lower) @ gradient
    asked = min(ascent, calm, 0.9 * fastest if fastest > 0 else fastest) if ascent > 0 else min(ascent, fastest)
    assert -ROWS.outputs[1][0] >= asked - 1e-9


def test_what_is_no_plane_is_refused() -> None:
    planes = ([0, 0], [0, 0, 1]), ([0, 0, 0], [0, 0, 0]), ([np.nan, 0, 0], [0, 0, 1])
    refuses(KeepOut.through, *((plane, "normal") for plane in planes))


def test_a_hand_that_may_be_as_fast_as_it_is_can_be_slowed_within_the_accelerations() -> None:
    # Joints about as fast as they may be, and a hand, too, of the ways drawn the one that its posture makes fastest.
    chain, dt, fastest, rng = ur5(), 0.005, 0.25, np.random.default_rng(20261126)
    bounds = HandBounds(chain, 0.3, 0.12, fastest, 10.0, (), rate=20.0, dt=dt, recovery_speed=0.1)
    q, v = ca.SX.sym("q", 6), ca.SX.sym("v", 6)
    w, gradient = bounds.manipulability(q)
    place, hand = chain.pose_expression(q)[:3, 3], chain.jacobian_expression(q)[:3, :] @ v
    kept = ca.Function("kept", [q, v], [bounds.kept(q, v, place, w=w, gradient=gradient, here=place, hand=hand)[0]])

    def speeds(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        tools = np.array([chain.pose(q + part * dt * v)[:3, 3] for part in (0.0, 0.5, 1.0)])
        return np.linalg.norm(np.diff(tools, axis=0), axis=1) / (dt / 2)

    judged = 0
    for _ in range(600):
        posture = rng.uniform(-np.pi, np.pi, 6)
        jacobian = chain.jacobian(posture)[:3]
        free, ways = np.linalg.svd(jacobian)[2][3:].T @ rng.normal(size=(3, 10)), rng.normal(size=(3, 10))
        drawn = 3 * free / np.abs(free).max(axis=0) + np.linalg.pinv(jacobian) @ ways * 0.24 / np.linalg.norm(
            ways, axis=0
        )
        velocity = max(drawn.T, key=lambda each: speeds(posture, each)[1])
        velocity *= min(np.pi / np.abs(velocity).max(), 0.998 * fastest / speeds(posture, velocity).max())
        if kept(posture, velocity):
            slower = velocity * max(0.0, 1 - 15.0 * dt / np.abs(velocity).max())
            assert speeds(posture + dt * velocity, slower).max() <= fastest * (1 + 1e-6)
            judged += 1
    assert judged > 40
