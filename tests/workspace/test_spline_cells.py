"""Series for the cells of a grid give what the sum over all landmarks gives, and give way to it where they cannot."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rehab_opt.workspace.spline import ThinPlateSpline
from rehab_opt.workspace.spline_cells import cells_of
from rehab_opt.workspace.spline_kernel import jacobians, values

Array = NDArray[np.float64]


def bent(source: Array) -> ThinPlateSpline:
    size = np.ptp(source, axis=0).max()
    return ThinPlateSpline(source, source + 0.05 * size * np.sin(7 * source[:, ::-1] / size))


def assert_single_points_agree(spline: ThinPlateSpline, points: Array) -> None:
    fit = spline._fit
    images, slopes = jacobians(fit, points)
    reach = np.abs(images).max() + np.abs(fit.weights).sum()
    np.testing.assert_allclose([spline(p) for p in points], values(fit, points), rtol=0, atol=1e-13 * reach)
    pairs = [spline.value_and_jacobian(p) for p in points]
    np.testing.assert_allclose([value for value, _ in pairs], images, rtol=0, atol=1e-13 * reach)
    tolerance = 1e-12 * (np.abs(slopes).max() + np.abs(fit.weights).sum() / fit.scale)
    np.testing.assert_allclose([slope for _, slope in pairs], slopes, rtol=0, atol=tolerance)


def scattered(spline: ThinPlateSpline, n: int, seed: int = 0) -> Array:
    """Points in the landmarks' box and a third of its size around it, so that some lie off the grid."""
    low, size = spline.source.min(axis=0), np.ptp(spline.source, axis=0)
    return low + np.random.default_rng(seed).uniform(-0.3, 1.3, (n, 2)) * size


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([64, 96, 200]), st.floats(-3, 3), st.floats(-2, 0))
def test_series_agree_with_the_sum(seed: int, n: int, scale: float, thinness: float) -> None:
    source = np.random.default_rng(seed).uniform(0, 1, (n, 2)) * [1, 10**thinness] * 10**scale
    spline = bent(source)
    assert_single_points_agree(spline, np.vstack((scattered(spline, 200, seed), source[:20])))


def test_crowded_landmarks_take_the_sum_and_agree() -> None:
    rng = np.random.default_rng(2)
    source = np.vstack((rng.uniform(0, 1, (60, 2)), 0.5 + 0.01 * rng.uniform(0, 1, (60, 2))))
    spline = bent(source)
    assert min(cells_of(spline._fit).place) == -1
    assert_single_points_agree(spline, np.vstack((scattered(spline, 100), source)))


def test_landmarks_on_outlines_and_corners_of_cells_agree() -> None:
    """On a regular grid points fall on the borders of cells and on landmarks."""
    axis = np.linspace(0, 1, 12)
    source = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    spline = bent(source)
    cells = cells_of(spline._fit)
    edges = (
        cells.corner + np.stack(np.meshgrid(np.arange(25), np.arange(25)), axis=-1).reshape(-1, 2) / cells.per_length
    )
    assert_single_points_agree(spline, np.vstack((source, edges)))
