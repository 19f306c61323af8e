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


def test_a_folded_start_is_unfolded_and_brought_home():
    side = np.linspace(-0.55, 0.55, 8)
    landmarks = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    fine = np.linspace(-0.55, 0.55, 23)
    points = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    rim = np.linspace(-0.5, 0.5, 20)[:-1]
    outline = np.concatenate([np.column_stack([rim, 0 * rim - 0.5]), np.column_stack([0 * rim + 0.5, rim])])
    outline = np.concatenate([outline, -outline])
    spline = sampled(landmarks, points, np.full(len(points), 1.0 / len(points)), outline)
    swapped = landmarks.copy()
    swapped[[27, 28]] = swapped[[28, 27]]
    crumpled = landmarks + 0.2 * np.random.default_rng(1).normal(size=landmarks.shape)
    for start in (swapped, crumpled):
        assert distortion(spline.jacobians(start), spline.fractions, 0.0) == np.inf
        ended = least_distorted(spline, start, box(-0.5, -0.5, 0.5, 0.5), 0.0)
        assert distortion(spline.jacobians(ended), spline.fractions, 0.0) < 1.05
        assert np.abs(ended - landmarks).max() < 0.05
