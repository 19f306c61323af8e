"""Sides and distances where edges nearly coincide, against shapely's exact predicates."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt.workspace.region import Workspace
from tests.workspace.polygons import around, polygons

FRAME = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
TOUCHING = {
    "a hole's corner on an edge": shapely.Polygon(FRAME, [[(-1, 0), (0, 0.5), (0, -0.5)]]),
    # Seen from its own ring each corner at the origin names another side: the hole goes around the outline's tip.
    "a hole around the outline's tip": shapely.Polygon(
        [*FRAME, (-1, 0.05), (0, 0), (-1, -0.05)], [[(0, 0), (-0.5, 0.2), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.2)]]
    ),
    "two parts at a corner": shapely.MultiPolygon(
        [shapely.Polygon([(0, 0), (-1, 0.5), (-1, -0.5)]), shapely.Polygon([(0, 0), (1, 0.5), (1, -0.5)])]
    ),
    "two holes at a corner": shapely.Polygon(
        FRAME, [[(0, 0), (0.5, 0.4), (0.5, -0.4)], [(0, 0), (-0.5, -0.4), (-0.5, 0.4)]]
    ),
}


def spike(angle: float) -> shapely.Polygon:
    """A box with a thorn to (1, 0) of that angle at its tip [rad]."""
    half = angle / 4
    return shapely.Polygon([(0, -0.2), (0.5, -0.2), (0.5, -half), (1, 0), (0.5, half), (0.5, 0.2), (0, 0.2)])


def turned(polygon: shapely.Geometry, angle: float, x: float, y: float) -> shapely.Geometry:
    c, s = math.cos(angle), math.sin(angle)
    return shapely.transform(polygon, lambda points: points @ np.array([[c, s], [-s, c]]) + (x, y))


def assert_right_sides(polygon: shapely.Geometry, points: np.ndarray) -> None:
    """Signs of distances and `contains` are shapely's, for points that are clear of the boundary's rounding."""
    assert polygon.is_valid
    asked = Workspace(polygon, accuracy=1e-3)
    exact = shapely.distance(polygon.boundary, shapely.points(points))
    points, exact = points[exact > 1e-11], exact[exact > 1e-11]
    assert len(points) > 50
    inside = shapely.contains_xy(polygon, *points.T)
    one_by_one = np.array([asked.distance(point) for point in points])
    np.testing.assert_array_equal(one_by_one < 0, inside)
    np.testing.assert_allclose(np.abs(one_by_one), exact, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal([asked.contains(point) for point in points], inside)
    np.testing.assert_array_equal(asked.contains(points), inside)


@pytest.mark.parametrize("angle", [1e-1, 1e-8, 1e-10, 1e-14])
@pytest.mark.parametrize("cut_out", [False, True])
def test_a_thorn_however_sharp_does_not_turn_sides_around(angle: float, cut_out: bool) -> None:
    shape = spike(angle)
    shape = shapely.box(-1, -1, 1.5, 1).difference(shape) if cut_out else shape
    rng = np.random.default_rng(0)
    beside = np.column_stack((1 + 1e-9 * rng.standard_normal(150), rng.uniform(-0.02, 0.02, 150)))
    above = np.column_stack((np.ones(100), rng.uniform(-1, 1, 100)))
    along = np.column_stack((rng.uniform(0.5, 1, 150), 1e-3 * rng.standard_normal(150)))
    points = np.concatenate((beside, above, along, around(shape, 200, 1.5, 1)))
    assert_right_sides(shape, points)
    if not cut_out:
        c, s = math.cos(0.3), math.sin(0.3)
        assert_right_sides(turned(shape, 0.3, 3, 4), points @ np.array([[c, s], [-s, c]]) + (3, 4))


@pytest.mark.parametrize("name", TOUCHING)
def test_rings_that_touch_do_not_turn_sides_around(name: str) -> None:
    rng = np.random.default_rng(0)
    close = [0.01 * rng.standard_normal((300, 2)) + corner for corner in ((0, 0), (-1, 0))]
    beyond = np.column_stack((-1 - rng.uniform(0, 0.02, 100), np.zeros(100)))
    assert_right_sides(TOUCHING[name], np.concatenate((*close, beyond, around(TOUCHING[name], 400, 2.0, 1))))


@pytest.mark.parametrize("length", [1e-120, 1e-155, 1e-170, 5e-324])
def test_an_edge_without_length_in_floating_point_turns_nothing_around(length: float) -> None:
    asked = Workspace(shapely.Polygon([(0, 0), (length, 0), (1, -0.5), (1, 1)]), accuracy=1e-3)
    assert asked.distance((-1.0, 0.0)) == pytest.approx(1.0)
    assert asked.distance((0.0, -3.0)) > 0
    assert asked.contains((0.5, 0.2)) is True
    assert asked.contains((-1e-3, 0.0)) is False


@pytest.mark.parametrize("name", TOUCHING)
@pytest.mark.parametrize("reach", [1.5, 30.0])
def test_what_is_nearest_is_inside_and_stays_where_it_is(name: str, reach: float) -> None:
    asked = Workspace(TOUCHING[name], accuracy=1e-3)
    for point in around(TOUCHING[name], 150, reach, 2):
        foot = asked.nearest(point)
        assert asked.contains(foot)
        np.testing.assert_array_equal(asked.nearest(foot), foot)


@settings(max_examples=20)
@given(polygons(), st.sampled_from([1.1, 3.0, 15.0, 80.0]), st.integers(0, 2**16))
def test_rows_are_answered_as_one_by_one(polygon: shapely.Geometry, reach: float, seed: int) -> None:
    asked = Workspace(polygon, accuracy=1e-3)
    odd = [(math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.inf), (1e200, 0.0), (1e90, 1e90)]
    points = np.concatenate((around(polygon, 150, reach, seed), shapely.get_coordinates(polygon)[:30], odd))
    one_by_one = [asked.distance(point) for point in points]
    np.testing.assert_allclose(asked.distance(points), one_by_one, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(asked.contains(points), [asked.contains(point) for point in points])


@settings(max_examples=5)
@given(st.integers(300, 900), st.floats(0.0, 0.3), st.integers(0, 2**16))
def test_ragged_outlines_of_many_corners_are_searched_exactly(corners: int, ragged: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * math.pi, corners, endpoint=False)
    radius = 0.3 * (1 - ragged * rng.random(corners))
    polygon = shapely.Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))) + (4.0, -3.0))
    for reach in (0.4, 1.5, 8.0):
        points = around(polygon, 80, reach, seed)
        exact = shapely.distance(polygon.boundary, shapely.points(points))
        asked = Workspace(polygon, accuracy=1e-3)
        np.testing.assert_allclose(np.abs([asked.distance(point) for point in points]), exact, atol=1e-14)
