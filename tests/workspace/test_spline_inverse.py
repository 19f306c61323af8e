"""The inverse of a thin-plate spline is that of the map itself, and says so where there is none."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rehab_opt.workspace.spline import ThinPlateSpline

Array = NDArray[np.float64]


def grid(n: int = 5) -> Array:
    """n x n landmarks in the size of a workspace."""
    axis = np.linspace(0, 1, n)
    return np.stack(np.meshgrid(0.6 * axis - 0.4, 0.4 * axis + 0.1), axis=-1).reshape(-1, 2)


def mild(seed: int, n: int = 5) -> ThinPlateSpline:
    """n x n landmarks moved by a tenth of their spacing, then turned and stretched: the map does not fold."""
    rng = np.random.default_rng(seed)
    turn, stretch = rng.uniform(-math.pi, math.pi), rng.uniform(0.3, 3, 2)
    linear = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]) * stretch
    return ThinPlateSpline(grid(n), (grid(n) + rng.uniform(-0.04, 0.04, (n * n, 2)) / (n - 1)) @ linear)


def folded() -> ThinPlateSpline:
    """Two neighbouring landmarks change places."""
    target = grid().copy()
    target[[11, 12]] = target[[12, 11]]
    return ThinPlateSpline(grid(), target)


def inside(n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform((-0.4, 0.1), (0.2, 0.5), (n, 2))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.just(5))
@example(0, 20)  # whose rounding is that of many close landmarks
def test_there_and_back_on_maps_that_do_not_fold(seed: int, n: int) -> None:
    spline = mild(seed, n)
    points = inside(200, seed)
    assert (np.linalg.det(spline.jacobian(points)) > 0).all()
    np.testing.assert_allclose(spline.inverse(spline(points)), points, atol=1e-12)
    images = spline(points[:50])
    np.testing.assert_allclose(spline(spline.inverse(images)), images, atol=1e-12)
    np.testing.assert_allclose([spline.inverse(image) for image in images[:10]], points[:10], atol=1e-12)


@pytest.mark.parametrize("alone", [False, True])
def test_a_folded_map_gives_a_true_preimage_or_nan(alone: bool) -> None:
    spline = folded()
    points = inside(300)
    assert (np.linalg.det(spline.jacobian(points)) < 0).any()
    images = spline(points)
    found = np.array([spline.inverse(image) for image in images]) if alone else spline.inverse(images)
    known = ~np.isnan(found).any(axis=1)
    assert np.isnan(found[~known]).all()
    np.testing.assert_allclose(spline(found[known]), images[known], atol=1e-12)
    assert known.mean() > 0.95  # every one of these has a preimage: where it came from


@pytest.mark.parametrize("alone", [False, True])
def test_a_start_chooses_between_several_preimages(alone: bool) -> None:
    spline = folded()
    points = inside(300)
    images = spline(points)
    found = (
        np.array([spline.inverse(i, p) for i, p in zip(images, points, strict=True)])
        if alone
        else spline.inverse(images, points)
    )
    np.testing.assert_allclose(found, points, atol=1e-9)
    assert np.nanmax(np.abs(spline.inverse(images) - points)) > 0.01  # other branches exist


@pytest.mark.parametrize("alone", [False, True])
def test_a_point_that_nothing_is_mapped_to_has_no_inverse(alone: bool) -> None:
    """x -> (x, y^2) nearly: nothing lies below the fold."""
    axis = np.linspace(-1, 1, 9)
    source = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    spline = ThinPlateSpline(source, np.column_stack((source[:, 0], source[:, 1] ** 2)))
    images = np.column_stack((np.linspace(-0.5, 0.5, 7), np.full(7, -0.05)))
    found = np.array([spline.inverse(image) for image in images]) if alone else spline.inverse(images)
    fine = np.stack(np.meshgrid(np.linspace(-3, 3, 301), np.linspace(-3, 3, 301)), axis=-1).reshape(-1, 2)
    reached = spline(fine)
    for image, point in zip(images, found, strict=True):
        if np.isnan(point).any():
            assert np.hypot(*(reached - image).T).min() > 1e-3  # nothing comes near
        else:
            np.testing.assert_allclose(spline(point), image, atol=1e-10)
    assert np.isnan(found).any()


def test_a_useless_start_does_no_harm() -> None:
    spline = mild(3)
    points = inside(20)
    images = spline(points)
    for start in ([math.nan, 0.0], [1e9, -1e9], [0.0, math.inf]):
        np.testing.assert_allclose(spline.inverse(images, start), points, atol=1e-12)
        np.testing.assert_allclose(spline.inverse(images[0], start), points[0], atol=1e-12)


def test_numbers_that_overflow_have_no_preimage_and_say_nothing() -> None:
    assert np.isnan(mild(1).inverse([1e200, 1e200])).all()
    assert np.isnan(mild(1).inverse([[1e200, 1e200], [-1e300, 0.0]])).all()


def test_a_map_onto_a_line_has_no_inverse_off_it() -> None:
    spline = ThinPlateSpline(grid(), np.outer(grid()[:, 0], [1.0, 2.0]))
    assert np.isnan(spline.inverse(np.array([[0.1, 0.7], [0.0, 0.5]]))).all()
    assert np.isnan(spline.inverse(np.array([0.1, 0.7]))).all()
