"""What a workspace answers, against shapely and closed forms."""

import math
import pickle

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rehab_opt.workspace.placement import ShoulderPlacement
from rehab_opt.workspace.region import Workspace
from tests.refusals import refuses
from tests.workspace.polygons import around, polygons

SQUARE = shapely.box(0.0, 0.0, 2.0, 1.0)
EMPTY = Workspace(shapely.Polygon(), accuracy=1e-3, reason="out of reach")


def workspace(polygon: shapely.Geometry) -> Workspace:
    return Workspace(polygon, accuracy=1e-3)


@settings(max_examples=20)
@given(polygons(), st.sampled_from([1.5, 6.0, 60.0]), st.integers(0, 2**16))
def test_distance_is_that_to_the_boundary_with_its_sign(polygon: shapely.Geometry, reach: float, seed: int) -> None:
    points = around(polygon, 200, reach, seed)
    distances = workspace(polygon).distance(points)
    exact = shapely.distance(polygon.boundary, shapely.points(points))
    rounding = 1e-13 * (1 + np.abs(points).max())
    np.testing.assert_allclose(np.abs(distances), exact, rtol=1e-12, atol=rounding)
    clear = exact > rounding
    np.testing.assert_array_equal(distances[clear] < 0, shapely.contains_xy(polygon, *points[clear].T))


@settings(max_examples=20)
@given(polygons(), st.sampled_from([1.2, 5.0, 60.0]), st.integers(0, 2**16))
def test_the_nearest_point_is_reachable_and_as_far_as_the_distance_says(
    polygon: shapely.Geometry, reach: float, seed: int
) -> None:
    asked = workspace(polygon)
    for point in around(polygon, 40, reach, seed):
        foot = asked.nearest(point)
        assert asked.contains(foot)
        assert math.dist(foot, point) == pytest.approx(max(asked.distance(point), 0.0), abs=1e-12 * (1 + reach))


@pytest.mark.parametrize(
    "bad", [(math.nan, 0.0), (0.0, math.nan), (math.nan, math.inf), (math.inf, 0.0), (0.0, -math.inf)]
)
def test_nan_and_a_reading_that_is_missing_are_nowhere_and_infinity_is_infinitely_far(bad: tuple[float, float]) -> None:
    asked, far = workspace(SQUARE), math.nan if np.isnan(bad).any() else math.inf
    masked = np.ma.array([1.0, 0.5], mask=np.isnan(bad)) if math.isnan(far) else bad
    for point in (bad, masked):
        assert asked.contains(point) is False
        np.testing.assert_equal(asked.distance(point), far)
        assert np.isnan(asked.nearest(point)).all()
    assert not asked.contains([bad, (1.0, 0.5)])[0]
    np.testing.assert_equal(EMPTY.distance(bad), far)


@settings(max_examples=40)
@given(st.floats(), st.floats())
@example(-1e-12, -1e-12)
def test_no_number_raises(x: float, y: float) -> None:
    rounding = 4e-12 * (1 + abs(x) + abs(y)) if math.isfinite(x) and math.isfinite(y) else 0.0
    for asked in (workspace(SQUARE), EMPTY):
        inside, distance = asked.contains((x, y)), asked.distance((x, y))
        assert inside in ({True} if distance <= 0 else {True, False} if distance <= rounding else {False})
        assert asked.nearest((x, y)).shape == (2,)


def test_an_empty_workspace_is_an_answer() -> None:
    assert EMPTY.empty
    assert (EMPTY.area, EMPTY.components, EMPTY.holes) == (0.0, 0, 0)
    assert EMPTY.contains((0.0, 0.0)) is False
    assert EMPTY.contains([(0.0, 0.0)]).tolist() == [False]
    assert EMPTY.distance((0.0, 0.0)) == math.inf
    np.testing.assert_array_equal(EMPTY.distance([(0.0, 0.0), (math.nan, 0.0)]), [math.inf, math.nan])
    assert np.isnan(EMPTY.nearest((0.0, 0.0))).all()
    assert "out of reach" in repr(EMPTY)


def test_what_is_no_point_and_no_valid_polygon_is_refused_by_name() -> None:
    points = ["ab", None, np.zeros((2, 2, 2)), [[None, 1.0]], [[1j, 2.0]], [], np.zeros((2, 0))]
    for asked in (workspace(SQUARE), EMPTY):
        for question in (asked.contains, asked.distance):
            refuses(question, *(((each,), "points = ") for each in points))
        for question in (asked.nearest, asked.signed_distance_and_closest_point):
            refuses(question, *(((each,), "point = ") for each in points))
    crossed, endless = [(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 0), (1, 0), (math.inf, 1)]
    shapes = [None, "square", shapely.Point(0, 0), shapely.Polygon(crossed), shapely.Polygon(endless)]
    sizes = [shapely.box(0, 0, 1e-10, 1e-10), shapely.box(0, 0, 1e10, 1)]
    refuses(workspace, *(((each,), "polygon") for each in [*shapes, *sizes]))


def test_a_workspace_survives_pickling() -> None:
    placement = ShoulderPlacement((1.0, 2.0, 3.0), 0.4)
    asked = Workspace(SQUARE, accuracy=2e-3, height=-0.2, handle_tilt=0.03, placement=placement, reason="")
    asked.distance((0.0, 0.0))
    again = pickle.loads(pickle.dumps(asked))
    assert again.distance((5.0, 5.0)) == asked.distance((5.0, 5.0))
    assert again != asked
    assert len(pickle.dumps(asked)) < 2000  # the look-up is made again instead
    assert (again.accuracy, again.height, again.handle_tilt, again.placement) == (2e-3, -0.2, 0.03, placement)


@settings(max_examples=10)
@given(polygons(), st.floats(-5, 5), st.floats(-5, 5), st.floats(-7, 7), st.integers(0, 2**16))
def test_a_moved_shoulder_moves_its_workspace(
    polygon: shapely.Geometry, x: float, y: float, turn: float, seed: int
) -> None:
    here = Workspace(polygon, accuracy=1e-3, height=-0.24)
    placement = ShoulderPlacement((x, y, 0.9), turn)
    there = here.placed(placement)
    points = around(polygon, 30, 2.0, seed)
    np.testing.assert_allclose(there.distance(placement.to_robot(points)), here.distance(points), atol=1e-12)
    assert there.height == -0.24
    np.testing.assert_allclose(there.placed(ShoulderPlacement()).distance(points), here.distance(points), atol=1e-12)
