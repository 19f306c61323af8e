"""The proof: its bounds hold wherever one looks, and what folds, leaves or overlaps is not certified."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box, unary_union

from rehab_opt.workspace.cell_bounds import cell_bounds
from rehab_opt.workspace.certificate import certificate, covering
from rehab_opt.workspace.spline import ThinPlateSpline
from tests.workspace.mapped import crescent, ell, mapped, sliver, workspace

SQUARE = box(0.0, 0.0, 1.0, 1.0)


def grid(steps: int, low: float = -0.1, high: float = 1.1) -> np.ndarray:
    side = np.linspace(low, high, steps)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def inside_of(cells: np.ndarray, steps: int = 12) -> np.ndarray:
    """Points all over each triangle, its corners and edges too: (t, k, 2)."""
    a, b = np.meshgrid(*(np.linspace(0.0, 1.0, steps),) * 2)
    fractions = np.stack([a[a + b <= 1.0], b[a + b <= 1.0]], axis=1)
    fractions = np.column_stack([fractions, 1.0 - fractions.sum(axis=1)])
    return np.einsum("kc,tcx->tkx", fractions, cells)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.002, 0.02, 0.1, 0.5]), st.integers(4, 40))
def test_bounds_hold_all_over_random_triangles_of_random_splines(seed, size, landmarks):
    random = np.random.default_rng(seed)
    source = random.uniform(0.0, 1.0, (landmarks, 2))
    spline = ThinPlateSpline(source, source + 0.05 * random.normal(size=source.shape))
    # Triangles of any shape, a third of them around a landmark, where the second derivative is infinite.
    centres = np.concatenate([random.uniform(0.0, 1.0, (20, 2)), source[random.integers(landmarks, size=10)]])
    cells = centres[:, None] + size * random.normal(size=(30, 3, 2))
    bounds = cell_bounds(spline, cells)
    points = inside_of(cells)
    slopes = spline.jacobian(points.reshape(-1, 2)).reshape(*points.shape, 2)
    assert (np.linalg.det(slopes) >= bounds.determinant[:, None]).all()
    assert (np.linalg.norm(slopes, ord=2, axis=(2, 3)) <= bounds.stretch[:, None] + 1e-12).all()
    assert (np.linalg.det(slopes).min(axis=1) <= bounds.corner_determinant + 1e-9).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_points_of_a_triangle_that_is_not_turned_back_have_their_own_images(seed):
    random = np.random.default_rng(seed)
    source = random.uniform(0.0, 1.0, (15, 2))
    spline = ThinPlateSpline(source, source + 0.1 * random.normal(size=source.shape))
    cells = random.uniform(0.0, 1.0, (60, 1, 2)) + 0.03 * random.normal(size=(60, 3, 2))
    kept = cells[cell_bounds(spline, cells).turned_back > 0.0]
    for points in inside_of(kept, 6):
        apart = np.linalg.norm(points[:, None] - points, axis=2)
        images = spline(points)
        assert (np.linalg.norm(images[:, None] - images, axis=2)[apart > 1e-9] > 0.0).all()


def test_bounds_are_sharp_on_small_cells():
    points = grid(8)
    spline = ThinPlateSpline(points, points + 0.02 * np.sin(5.0 * points[:, ::-1]))
    cells = np.array([0.1, 0.25]) + np.array([[[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3]]])
    bounds = cell_bounds(spline, cells)
    assert bounds.determinant[0] == pytest.approx(bounds.corner_determinant[0], rel=0.02)


@pytest.mark.parametrize("polygon", [SQUARE, crescent(), ell(), sliver()])
def test_no_point_of_the_source_is_left_without_a_cell(polygon):
    cells = covering(workspace(polygon))
    assert unary_union([Polygon(cell) for cell in cells]).buffer(1e-12).contains(polygon)


def test_an_affine_map_is_certified_with_its_own_determinant_and_margin():
    points = grid(4)
    spline = ThinPlateSpline(points, 0.25 + points @ np.array([[0.5, 0.1], [0.0, 0.4]]))
    proven = certificate(spline, workspace(SQUARE), workspace(SQUARE))
    assert proven.valid
    assert proven.determinant == pytest.approx(0.2, rel=1e-9)
    true_margin = 1.0 - (0.25 + 0.1 + 0.4)  # of the corner that comes nearest
    assert 0.1 * true_margin < proven.margin <= true_margin


def test_a_fold_too_small_to_be_sampled_is_not_certified():
    points = grid(7)
    first, second = np.array([[0.43, 0.57], [0.43001, 0.57]])
    pinched = np.concatenate([points, [first, second]])
    spline = ThinPlateSpline(pinched, np.concatenate([points, [second, first]]) * 0.8 + 0.1)
    sampled = np.linalg.det(spline.jacobian(np.random.default_rng(0).uniform(0.0, 1.0, (20_000, 2))))
    assert (sampled > 0.0).all()
    assert np.linalg.det(spline.jacobian(0.5 * (first + second))) < 0.0
    proven = certificate(spline, workspace(SQUARE), workspace(box(-1.0, -1.0, 2.0, 2.0)))
    assert not proven.valid
    assert not proven.determinant > 0.0


def test_an_image_that_leaves_the_target_by_a_hair_is_not_certified():
    points = grid(4)
    target = workspace(SQUARE)
    for excess, certified in ((1e-3, False), (-1e-3, True)):
        spline = ThinPlateSpline(points, (points - 0.5) * (1.0 + 2.0 * excess) + 0.5)
        assert certificate(spline, workspace(SQUARE), target).valid is certified


def test_a_map_that_overlaps_without_folding_is_not_certified():
    angles, radii = np.meshgrid(np.linspace(-1.0, 1.0, 41) * 2.7, np.linspace(0.4, 1.1, 8))

    def bent(turn: float) -> np.ndarray:
        return np.stack([radii * np.cos(turn * angles), radii * np.sin(turn * angles)], axis=-1).reshape(-1, 2)

    along = np.linspace(-1.0, 1.0, 60) * 2.6
    rim = np.column_stack([np.cos(along), np.sin(along)])
    source, target = workspace(Polygon(np.concatenate([rim, 0.5 * rim[::-1]]))), workspace(box(-2.0, -2.0, 2.0, 2.0))
    for turn, certified in ((1.15, True), (1.3, False)):  # 1.3 * 2.6 rad is more than half a turn
        proven = certificate(ThinPlateSpline(bent(1.0), bent(turn)), source, target)
        assert proven.determinant > 0.0
        assert proven.outline_simple is certified
        assert proven.valid is certified


@pytest.mark.parametrize(("source", "target"), [("regular", "restricted"), ("crescent", "blob")])
def test_nothing_sampled_is_worse_than_what_is_proven(source, target):
    made = mapped(source, target)
    points = inside_of(covering(made.source), 8).reshape(-1, 2)
    points = points[made.source.contains(points)]
    assert made.certificate.valid
    assert np.linalg.det(made.spline.jacobian(points)).min() >= made.certificate.determinant > 0.0
    assert -np.max(made.target.distance(made.spline(points))) >= made.certificate.margin > 0.0
