"""The distance that a tick evaluates is shapely's, for outlines of any kind."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from rehab_opt.symbolic import BufferedFunction
from rehab_opt.workspace.edge_distance import distance_function, edge_columns, nearest_point_function
from tests.workspace.mapped import crescent, ell, shape

FRAME = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
TURN = np.linspace(0.0, 2 * np.pi, 301)[:-1]
OUTLINES = {
    "crescent": crescent(),
    "ell": ell(),
    "hole": box(-0.1, 0.3, 0.1, 0.5).difference(box(-0.02, 0.38, 0.03, 0.42)),
    "parts that touch": MultiPolygon([box(-0.1, 0.3, 0.0, 0.4), box(0.0, 0.4, 0.1, 0.5)]),
    "hole that touches": Polygon(box(0, 0, 1, 1).exterior, [[(0.5, 0.0), (0.7, 0.4), (0.3, 0.4)]]),
    "spike": Polygon([(0.0, 0.0), (0.3, 1e-4), (0.0, 2e-4), (-0.1, 0.1)]),
    "needle thinner than rounding": Polygon(
        [(0.1, -0.1), (0.1, 0.1), (0.4, 0.1), (0.1, 0.1 + 1e-16), (0.1, 0.3), (0.0, 0.3), (0.0, -0.1)]
    ),
    "sliver": Polygon([(0.0, 0.0), (0.3, 0.0), (0.3, 0.3), (0.15, 1e-9), (0.0, 0.3)]),
    "thorn": Polygon([(0, -0.2), (0.5, -0.2), (0.5, -1e-7), (1, 0), (0.5, 1e-7), (0.5, 0.2), (0, 0.2)]),
    "hole around the outline's tip": Polygon(
        [*FRAME, (-1, 0.05), (0, 0), (-1, -0.05)], [[(0, 0), (-0.5, 0.2), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.2)]]
    ),
    "two holes at a corner": Polygon(FRAME, [[(0, 0), (0.5, 0.4), (0.5, -0.4)], [(0, 0), (-0.5, -0.4), (-0.5, 0.4)]]),
    "turned about": Polygon(FRAME[::-1], [[(0.5, 0.0), (0.7, 0.4), (0.3, 0.4)][::-1]]),
    "edge without length": Polygon([(0, 0), (1e-155, 0), (1, -0.5), (1, 1)]),
    "waves": Polygon(np.column_stack([0.15 * np.cos(TURN), 0.1 * np.sin(TURN) + 0.01 * np.sin(9 * TURN)])),
}


@pytest.mark.parametrize("name", [*OUTLINES, "reached"])
def test_distance_side_and_nearest_point_are_those_of_shapely(name: str) -> None:
    outline = OUTLINES[name] if name in OUTLINES else shape("restricted").polygon
    edges, rng = edge_columns(outline), np.random.default_rng(len(name))
    asked = [BufferedFunction(each(len(edges))) for each in (distance_function, nearest_point_function)]
    corners = shapely.get_coordinates(outline)
    low, high = corners.min(axis=0), corners.max(axis=0)
    level = np.column_stack([rng.uniform(low[0] - 0.1, high[0] + 0.1, 300), rng.choice(corners[:, 1], 300)])
    points = np.vstack([rng.uniform(low - 0.2, high + 0.2, (700, 2)), rng.uniform(low, high, (700, 2)), corners, level])
    apart, inside = shapely.distance(outline.boundary, shapely.points(points)), shapely.contains_xy(outline, points)
    for point, distance, within in zip(points, apart, inside, strict=True):
        (signed,), (foot, nearest) = asked[0].of(point, edges), (asked[0].outputs[1], asked[1].of(point, edges))
        assert abs(signed) == pytest.approx(distance, abs=1e-14)
        assert np.linalg.norm(foot - point) == pytest.approx(distance, abs=1e-14)
        assert abs(signed) < 1e-14 or (signed < 0) == within
        assert np.array_equal(nearest, point if within else nearest)
        assert shapely.distance(outline, shapely.Point(nearest)) < 1e-14


def test_a_point_that_is_no_number_has_no_nearest_one() -> None:
    edges = edge_columns(ell())
    function = BufferedFunction(nearest_point_function(len(edges)))
    assert np.isnan(function.of([np.nan, 0.1], edges)).all()
