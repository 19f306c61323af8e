"""The optimisation behind the safe rule: its derivatives, its optimum, and what it never does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box

from rehab_opt.workspace.descent import descent
from rehab_opt.workspace.least_distortion import _distortion, _rotation_penalty, distortion, least_distorted, sampled
from rehab_opt.workspace.outline_pull import OutlinePull

SEEDS = st.integers(0, 2**32 - 1)


def stored(matrices: np.ndarray) -> np.ndarray:
    """Jacobians (m, i, j) as they are stored: [j, m, i]."""
    return np.moveaxis(matrices, 2, 0)


@given(SEEDS)
def test_rotations_distort_by_one_and_nothing_by_less(seed):
    random = np.random.default_rng(seed)
    angle = random.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    one = np.ones(1)
    assert distortion(stored(turn[None]), one, 0.0) == pytest.approx(1.0)
    other = turn + 0.5 * random.normal(size=(2, 2))
    assert distortion(stored(other[None]), one, 0.0) >= 1.0 - 1e-12


@given(SEEDS)
def test_what_folds_anywhere_costs_without_bound(seed):
    random = np.random.default_rng(seed)
    matrices = np.tile(np.eye(2), (5, 1, 1))
    matrices[random.integers(5)] = np.diag([1.0, -random.uniform(0.0, 1.0)])
    fractions = np.full(5, 0.2)
    assert distortion(stored(matrices), fractions, 0.0) == np.inf
    assert np.isfinite(distortion(stored(matrices), fractions, 0.1))


@settings(max_examples=50)
@given(SEEDS, st.sampled_from([0.0, 0.01, 0.5]))
def test_derivatives_of_distortion_are_those_of_differences(seed, eps):
    random = np.random.default_rng(seed)
    spread = 0.2 if eps == 0.0 else 0.8
    J = stored(np.eye(2) + spread * np.clip(random.normal(size=(4, 2, 2)), -1.5, 1.5))
    fractions = random.dirichlet(np.ones(4))
    step = 1e-6 * random.normal(size=J.shape)
    for value in (lambda K: _distortion(K, fractions, eps), lambda K: _rotation_penalty(K, fractions, 0.3)):
        by_difference = (value(J + step)[0] - value(J - step)[0]) / 2.0
        assert float((value(J)[1] * step).sum()) == pytest.approx(by_difference, rel=1e-4, abs=1e-10)


@settings(max_examples=30)
@given(SEEDS)
def test_derivatives_of_the_pull_are_those_of_differences(seed):
    random = np.random.default_rng(seed)
    values, before = random.normal(size=(12, 5)), 3.0 * random.normal(size=(12, 2))
    pull = OutlinePull(box(-1.0, -1.0, 1.0, 1.0), values, before, inside=2.0, outside=50.0)
    pull.keep_apart()
    pull.tighten()
    Y, step = random.normal(size=(5, 2)), 1e-7 * random.normal(size=(5, 2))
    by_difference = (pull(Y + step)[0] - pull(Y - step)[0]) / 2.0
    assert float((pull(Y)[1] * step).sum()) == pytest.approx(by_difference, rel=1e-3, abs=1e-8)


def test_points_outside_are_seen_and_crossings_too():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    pull = OutlinePull(box(0.0, 0.0, 0.9, 1.0), np.eye(4), square, inside=1.0, outside=1.0)
    assert pull.outside(square) == pytest.approx(0.1)
    assert pull.outside(0.5 * square + 0.1) == 0.0
    assert pull.simple(square)
    assert not pull.simple(square[[0, 2, 1, 3]])


def test_descent_finds_the_minimum_of_a_quadratic_and_never_leaves_the_domain():
    random = np.random.default_rng(0)
    root = random.normal(size=(6, 6))
    curvature, goal = root @ root.T + np.eye(6), random.normal(size=(6, 2))

    def cost(Y):
        assert np.isfinite(Y).all()
        if Y[0, 0] > goal[0, 0] + 0.5:
            return np.inf, Y
        return float(((Y - goal) * (curvature @ (Y - goal))).sum()), 2.0 * curvature @ (Y - goal)

    found, stopped = descent(cost, np.zeros((6, 2)) + goal - 3.0, np.eye(6), steps=200, enough=1e-14)
    assert found == pytest.approx(goal, abs=1e-5)
    assert not stopped


def test_descent_keeps_what_it_is_asked_to_keep():
    def cost(Y):
        return float((Y**2).sum()), 2.0 * Y

    found, stopped = descent(
        cost, np.full((2, 1), 9.0), 100.0 * np.eye(2), steps=50, enough=1e-12, keeps=lambda Y: Y[0, 0] > 4.0
    )
    assert stopped
    assert 4.0 < found[0, 0] <= 9.0


def test_sampled_splines_are_linear_in_their_landmarks_and_exact_on_affine_images():
    random = np.random.default_rng(0)
    landmarks, points = random.uniform(size=(12, 2)), random.uniform(size=(7, 2))
    spline = sampled(landmarks, points, np.full(7, 1 / 7), points)
    matrix = random.normal(size=(2, 2))
    assert spline.outline @ (landmarks @ matrix.T) == pytest.approx(points @ matrix.T, abs=1e-9)
    assert np.moveaxis(spline.jacobians(landmarks @ matrix.T), 0, 2) == pytest.approx(
        np.tile(matrix, (7, 1, 1)), abs=1e-9
    )


def test_a_folded_start_is_unfolded_and_brought_home():
    side = np.linspace(-0.55, 0.55, 8)
    landmarks = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    fine = np.linspace(-0.55, 0.55, 23)
    points = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    rim = np.linspace(-0.5, 0.5, 20)[:-1]
    outline = np.concatenate([np.column_stack([rim, 0 * rim - 0.5]), np.column_stack([0 * rim + 0.5, rim])])
    outline = np.concatenate([outline, -outline])
    spline = sampled(landmarks, points, np.full(len(points), 1.0 / len(points)), outline)
    start = landmarks.copy()
    start[[27, 28]] = start[[28, 27]]  # two neighbours swapped
    assert distortion(spline.jacobians(start), spline.fractions, 0.0) == np.inf
    ended = least_distorted(spline, start, box(-0.5, -0.5, 0.5, 0.5), 0.0)
    assert distortion(spline.jacobians(ended), spline.fractions, 0.0) < 1.05
    assert np.abs(ended - landmarks).max() < 0.05
