"""The B-spline of a map: scipy's numbers, its slopes, its refinement, its inverse, and the same numbers in C."""

import pickle
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import BSpline

from rehab_opt.workspace.bspline import PlaneBSpline, net_columns


def knots(cells: int) -> np.ndarray:
    return np.arange(-3.0, cells + 4.0)


def fitted(function, low, step, cells: tuple[int, int]) -> PlaneBSpline:
    """The B-spline nearest to a function (m, 2) -> (m, 2) on a grid of points; its bases are scipy's."""
    u, v = (np.linspace(0.0, n, 4 * n + 1) for n in cells)
    Bx, By = (BSpline.design_matrix(t, knots(n), 3).toarray() for t, n in zip((u, v), cells, strict=True))
    points = np.stack(np.meshgrid(low[0] + step[0] * u, low[1] + step[1] * v, indexing="ij"), axis=-1)
    values = function(points.reshape(-1, 2)).reshape(points.shape)
    coefficients = np.einsum("ai,ijc,bj->abc", np.linalg.pinv(Bx), values, np.linalg.pinv(By), optimize=True)
    return PlaneBSpline(np.array(low), np.array(step), coefficients)


def wavy(seed: int, cells: tuple[int, int] = (5, 7), bend: float = 0.01) -> PlaneBSpline:
    """Coefficients of a linear map, moved at random."""
    random = np.random.default_rng(seed)
    low, step = random.normal(size=2), random.uniform(0.02, 0.08, 2)
    grid = np.stack(np.meshgrid(*(np.arange(n + 3.0) for n in cells), indexing="ij"), axis=-1) * step
    return PlaneBSpline(low, step, grid @ random.normal(size=(2, 2)) + bend * random.normal(size=grid.shape))


def all_over(spline: PlaneBSpline, count: int, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return spline.low + spline.step * spline.cells * random.random((count, 2))


@pytest.mark.parametrize("seed", range(5))
def test_images_and_slopes_are_those_of_scipys_splines(seed):
    spline = wavy(seed)
    points = all_over(spline, 300, seed)
    u = (points - spline.low) / spline.step
    bases = [[BSpline(knots(n), np.eye(n + 3), 3)(u[:, i], d) for d in (0, 1)] for i, n in enumerate(spline.cells)]
    images, slopes = spline.evaluate(points)
    for (dx, dy), ours in (((0, 0), images), ((1, 0), slopes[:, :, 0]), ((0, 1), slopes[:, :, 1])):
        theirs = np.einsum("mi,mj,ijc->mc", bases[0][dx], bases[1][dy], spline.coefficients)
        scale = spline.step[0] ** dx * spline.step[1] ** dy
        np.testing.assert_allclose(ours, theirs / scale, rtol=0, atol=1e-12)
    for order in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)):
        columns = net_columns(points, spline.low, spline.step, spline.cells, order)
        each = [
            BSpline(knots(n), np.eye(n + 3), 3)(u[:, i], d) / spline.step[i] ** d
            for i, (n, d) in enumerate(zip(spline.cells, order, strict=True))
        ]
        theirs = np.einsum("mi,mj->mij", *each).reshape(len(points), -1)
        np.testing.assert_allclose(columns.toarray(), theirs, rtol=1e-12, atol=1e-9)


def test_one_point_or_many_in_python_or_casadi_are_the_same_and_nan_stays_nan():
    spline = wavy(1)
    points = all_over(spline, 200)
    images, slopes = spline.evaluate(points)
    for point, image, slope in zip(points, images, slopes, strict=True):
        np.testing.assert_allclose(spline(point), image, rtol=0, atol=1e-14)
        one, J = spline.value_and_jacobian(point)
        np.testing.assert_allclose(one, image, rtol=0, atol=1e-14)
        np.testing.assert_allclose(J, slope, rtol=0, atol=1e-12)
    far = spline.low - [3.0, -30.0]
    np.testing.assert_allclose(spline(far), spline(np.array([far]))[0], rtol=0, atol=1e-14)
    for bad in ([np.nan, 0.0], [0.0, np.nan]):
        assert np.isnan(spline(np.array(bad))).all()
        assert np.isnan(spline.jacobian(np.array(bad))).all()


def test_the_inverse_returns_every_point_and_copies_are_the_same_map():
    spline = wavy(3, bend=2e-3)
    points = all_over(spline, 500)
    assert np.abs(spline.inverse(spline(points)) - points).max() < 1e-12
    assert np.isnan(spline.inverse([[1e6, 0.0], [np.nan, 0.0]])).all()
    other = pickle.loads(pickle.dumps(spline))
    np.testing.assert_array_equal(other(points), spline(points))
    with pytest.raises(ValueError, match="read-only"):
        other.coefficients[0] = 0.0


def test_c_has_the_numbers_of_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    spline = wavy(4)
    monkeypatch.chdir(tmp_path)  # casadi writes where it is
    spline.statement.generate("map.c")
    subprocess.run(["cc", "-O2", "-fPIC", "-shared", "map.c", "-o", "map.so"], check=True, cwd=tmp_path)
    in_c = ca.external("plane_map", str(tmp_path / "map.so"))
    points = all_over(spline, 500)
    for point, image, slope in zip(points, *spline.evaluate(points), strict=True):
        ours = [each.full() for each in in_c(point)]
        np.testing.assert_allclose(ours[0].ravel(), image, rtol=0, atol=1e-12)
        np.testing.assert_allclose(ours[1], slope, rtol=0, atol=1e-12)
    assert np.isnan(in_c([np.nan, 0.0])[0].full()).all()
