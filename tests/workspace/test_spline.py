"""A thin-plate spline goes through its landmarks, bends as little as they allow, and is what scipy makes of them."""

import copy
import math
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.special import xlogy

from rehab_opt.workspace.spline import ThinPlateSpline
from tests.refusals import refuses

Array = NDArray[np.float64]

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


def landmarks(seed: int, n: int, *, bend: float = 0.02) -> tuple[Array, Array]:
    """Sources in a rectangle somewhere, at least a fiftieth of the mean spacing apart; targets near an affine image."""
    rng = np.random.default_rng(seed)
    size, offset = rng.uniform(0.05, 2, 2), rng.uniform(-1, 1, 2)
    source = rng.uniform(0, 1, (n, 2)) * size + offset
    linear = np.eye(2) + rng.uniform(-0.3, 0.3, (2, 2))
    return source, source @ linear + rng.uniform(-1, 1, 2) + bend * size.min() * rng.normal(size=(n, 2))


@st.composite
def cases(draw: st.DrawFn, most: int = 40) -> tuple[Array, Array]:
    """Random landmarks, no two nearly the same and not nearly on a line."""
    source, target = landmarks(draw(st.integers(0, 2**32 - 1)), draw(st.integers(3, most)))
    centred = source - source.mean(axis=0)
    apart = np.hypot(*(source[:, None] - source).T) + 9 * np.eye(len(source))
    spread = np.linalg.svd(centred, compute_uv=False)
    assume(apart.min() > 1e-3 * np.ptp(source) and spread[1] > 1e-2 * spread[0])
    return source, target


def around(source: Array, n: int, seed: int = 0) -> Array:
    """Points in the landmarks' box and half its size around it."""
    low, size = source.min(axis=0), np.ptp(source, axis=0)
    return low + np.random.default_rng(seed).uniform(-0.5, 1.5, (n, 2)) * size


@settings(max_examples=60, deadline=None)
@given(cases())
def test_it_is_the_spline_that_scipy_makes_of_the_landmarks(case: tuple[Array, Array]) -> None:
    source, target = case
    oracle, points = RBFInterpolator(source, target, kernel="thin_plate_spline"), around(source, 50)
    np.testing.assert_allclose(ThinPlateSpline(source, target)(points), oracle(points), rtol=1e-8, atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(cases())
def test_weights_and_affine_part_solve_the_papers_equations(case: tuple[Array, Array]) -> None:
    """Eq. (27)."""
    source, target = case
    n = len(source)
    spline = ThinPlateSpline(source, target)
    R = np.column_stack((np.ones(n), source))
    square = np.sum((source[:, None] - source) ** 2, axis=2)
    assert spline.weights.shape == (n, 2)
    assert spline.affine.shape == (3, 2)
    size = np.abs(spline.weights).max()
    np.testing.assert_allclose(xlogy(square, square) @ spline.weights + R @ spline.affine, target, atol=1e-10)
    np.testing.assert_allclose(R.T @ spline.weights, 0, atol=1e-12 * max(size, 1e-3) * n)


@settings(max_examples=30, deadline=None)
@given(cases())
def test_its_jacobian_is_its_derivative(case: tuple[Array, Array]) -> None:
    source, target = case
    spline = ThinPlateSpline(source, target)
    points = around(source, 20)
    # A difference is off by h^2 times the third derivatives, which grow like w / r near a landmark: keep away.
    step = 1e-4 * np.ptp(source, axis=0).min()
    away = np.hypot(*(points[:, None] - source).T).min(axis=0) > 20 * step
    points = points[away]
    columns = [(spline(points + h) - spline(points - h)) / (2 * step) for h in step * np.eye(2)]
    size = np.abs(spline.affine[1:]).max() + np.abs(spline.weights).max() * np.ptp(source)
    np.testing.assert_allclose(spline.jacobian(points), np.stack(columns, axis=2), atol=1e-5 * size)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 150), st.floats(-4, 4), st.floats(-4, 2))
def test_affine_data_give_weights_that_are_exactly_zero(seed: int, n: int, shift: float, scale: float) -> None:
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (n, 2)) * 10**scale + 10**shift
    target = source @ rng.normal(size=(2, 2)) + rng.normal(size=2)
    assume(np.linalg.svd(source - source.mean(axis=0), compute_uv=False)[1] > 1e-6 * 10**shift)
    spline = ThinPlateSpline(source, target)
    assert not spline.weights.any()
    np.testing.assert_allclose(spline(source), target, atol=1e-12 * max(np.abs(target).max(), np.abs(source).max()))


def test_a_bend_of_a_nanometre_is_not_taken_for_rounding() -> None:
    source, _ = landmarks(3, 30)
    target = source.copy()
    target[7] += 1e-9
    spline = ThinPlateSpline(source, target)
    assert spline.weights.all()
    np.testing.assert_allclose(spline(source), target, atol=1e-14)


def test_eight_hundred_landmarks_are_met() -> None:
    grid = np.stack(np.meshgrid(np.linspace(0, 0.6, 32), np.linspace(0, 0.4, 25)), axis=-1).reshape(-1, 2)
    target = grid + 0.02 * np.sin(9 * grid[:, ::-1])
    spline = ThinPlateSpline(grid, target)
    np.testing.assert_allclose(spline(grid), target, atol=1e-11)
    np.testing.assert_allclose([spline(point) for point in grid[::40]], spline(grid[::40]), atol=1e-13)
    np.testing.assert_allclose(
        spline(np.array([0.3, 0.2])), [0.3 + 0.02 * math.sin(1.8), 0.2 + 0.02 * math.sin(2.7)], atol=1e-4
    )


# ------------------------------------------------------------------------------------------ single points and arrays
@settings(max_examples=20, deadline=None)
@given(st.sampled_from([3, 4, 20, 33, 64]), st.integers(0, 2**32 - 1))
def test_a_point_alone_and_in_an_array_has_the_same_image(n: int, seed: int) -> None:
    source, target = landmarks(seed, n)
    spline = ThinPlateSpline(source, target)
    points = np.vstack((around(source, 5), source[:3]))
    images, slopes = spline(points), spline.jacobian(points)
    size = 1 + np.abs(slopes).max()
    for point, image, slope in zip(points, images, slopes, strict=True):
        np.testing.assert_allclose(spline(point), image, rtol=1e-12, atol=1e-12 * size)
        np.testing.assert_allclose(spline(point.tolist()), spline(point), rtol=0, atol=0)
        np.testing.assert_allclose(spline.jacobian(point), slope, atol=1e-11 * size)
        value, jacobian = spline.value_and_jacobian(point)
        np.testing.assert_allclose(value, image, rtol=1e-12, atol=1e-12 * size)
        np.testing.assert_allclose(jacobian, slope, atol=1e-11 * size)


def test_what_is_no_number_stays_so_and_harms_no_neighbour() -> None:
    for target_of in (lambda s: s, lambda s: s**2):  # affine and bent
        source, _ = landmarks(9, 100)
        spline = ThinPlateSpline(source, target_of(source))
        spline(source.mean(axis=0))
        points = np.array([[math.nan, 0.1], [0.1, 0.2], [0.1, math.nan], [math.inf, 0.0]])
        for row in (0, 2, 3):
            assert np.isnan(spline.inverse(points)[row]).all()
            assert np.isnan(spline.inverse(points[row])).all()
            assert not np.isfinite(spline(points)[row]).all()
            assert not np.isfinite(spline(points[row])).all()
            assert np.isnan(spline.jacobian(points)[row]).any()
            assert np.isnan(spline.jacobian(points[row])).any()
        np.testing.assert_allclose(spline(points)[1], spline(points[1]), rtol=1e-12)
        assert np.isfinite(spline.inverse(points)[1]).all() == np.isfinite(spline.inverse(points[1])).all()


def test_numbers_are_copies_that_the_next_call_does_not_overwrite() -> None:
    spline = ThinPlateSpline(*landmarks(11, 20))
    image, slope = spline.value_and_jacobian(np.zeros(2))
    kept = image.copy(), slope.copy()
    spline.value_and_jacobian(np.ones(2))
    np.testing.assert_array_equal(image, kept[0])
    np.testing.assert_array_equal(slope, kept[1])
    value = spline(np.zeros(2))
    spline(np.ones(2))
    np.testing.assert_array_equal(value, spline(np.zeros(2)))


def test_copies_and_pickles_are_the_same_map_and_as_unchangeable() -> None:
    spline = ThinPlateSpline(*landmarks(13, 20))
    point = spline.source.mean(axis=0)
    spline.inverse(spline(point))  # with buffers and starts made
    for other in (pickle.loads(pickle.dumps(spline)), copy.copy(spline), copy.deepcopy(spline)):
        np.testing.assert_array_equal(other(point), spline(point))
        np.testing.assert_array_equal(other.inverse(point), spline.inverse(point))
        for array in (other.source, other.target, other.weights, other.affine):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0
        with pytest.raises(FrozenInstanceError):
            other.source = spline.source


# ---------------------------------------------------------------------------------------------------------- refusals
GRID = np.stack(np.meshgrid(np.linspace(0, 1, 10), np.linspace(0, 1, 10)), axis=-1).reshape(-1, 2)
TORN = (np.vstack((GRID, GRID[7] + 3e-7)), np.vstack((GRID, [[5, 5]])))
NAN = [[0, 0], [1, 0], [0, math.nan], [1, 1]]


def close(fraction: float) -> Array:
    """The grid, and a point that is so near to one of it, in root mean square distances from the mean."""
    twice = np.vstack((GRID, GRID[7]))
    spread = np.linalg.norm(twice - twice.mean(axis=0)) / math.sqrt(len(twice))
    return twice + np.outer(np.arange(101) == 100, [fraction * spread, 0.0])


def test_landmarks_that_determine_no_map_and_what_is_no_point_are_refused_by_name() -> None:
    masked = np.ma.masked_array(SQUARE, [[0, 0], [0, 0], [1, 0], [0, 0]])
    refuses(
        ThinPlateSpline,
        ((SQUARE[:2], SQUARE[:2]), "source = "),
        ((SQUARE[:3], SQUARE), "target = "),
        ((NAN, SQUARE), "source[2] = "),
        ((SQUARE, NAN), "target[2] = "),
        ((SQUARE * 1e200, SQUARE), "source[1] = "),
        ((np.vstack((SQUARE, SQUARE[1])), np.vstack((SQUARE, [[5, 5]]))), "source[1], source[4] = "),
        (TORN, "source[7], source[100] = "),
        ((close(0.999e-7), close(0.999e-7)), "source[7], source[100] = "),
        ((masked, SQUARE), "source[2] = "),
        ((np.outer(np.arange(5), [0.3, 0.7]), np.eye(5, 2)), "source = "),
        ((np.outer(np.linspace(0, 1, 3), [1, 1]) * 1e-6, SQUARE[:3]), "source = "),
    )
    assert not ThinPlateSpline(close(1.001e-7), close(1.001e-7)).weights.any()
    spline = ThinPlateSpline(SQUARE, SQUARE)
    for method in (spline, spline.jacobian, spline.inverse, spline.value_and_jacobian):
        wrong = ([1.0, 2.0, 3.0], np.zeros((2, 3)), "here", np.array([None, 1.0]), [10**400, 0])
        refuses(method, *(((each,), "point", " = ") for each in wrong))
