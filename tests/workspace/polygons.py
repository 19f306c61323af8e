"""Polygons of every kind, for claims about workspaces."""

import math

import numpy as np
import shapely
from hypothesis import strategies as st


@st.composite
def polygons(draw: st.DrawFn) -> shapely.Polygon | shapely.MultiPolygon:
    """Star-like outlines of 3 to 60 corners, some with a hole, an island or a sliver; 1 mm to 10 m, near or far."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = 10 ** draw(st.floats(-3, 1))
    flat = draw(st.sampled_from([1.0, 1.0, 0.1, 0.01]))
    angles = np.sort(rng.uniform(0, 2 * math.pi, draw(st.integers(3, 60))))
    outline = rng.uniform(0.3, 1.0, angles.size)[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    shape = shapely.Polygon(outline).buffer(0)
    if draw(st.booleans()):
        shape = shape.difference(shapely.Point(*rng.uniform(-0.2, 0.2, 2)).buffer(0.15, quad_segs=2))
    if draw(st.booleans()):
        shape = shape.union(shapely.box(1.5, -0.2, 1.7, 0.5))
    turn = rng.uniform(0, 2 * math.pi)
    shift = rng.uniform(-1, 1, 2) * draw(st.sampled_from([0.0, 1.0, 5.0]))
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])

    def placed(points: np.ndarray) -> np.ndarray:
        return (points * (size, size * flat)) @ rotation.T + shift

    moved = shapely.transform(shape, placed)
    parts = [part for part in shapely.get_parts(moved) if isinstance(part, shapely.Polygon) and part.area > 1e-14]
    whole = shapely.MultiPolygon(parts) if len(parts) > 1 else (parts[0] if parts else shapely.box(0, 0, size, size))
    return whole if whole.is_valid else shapely.box(0, 0, size, size)


def around(polygon: shapely.Geometry, count: int, reach: float, seed: int) -> np.ndarray:
    """(count, 2) points over `reach` sizes of the polygon, a third near its boundary, half of them at corners."""
    rng = np.random.default_rng(seed)
    low_x, low_y, high_x, high_y = polygon.bounds
    size = max(high_x - low_x, high_y - low_y)
    middle = np.array((low_x + high_x, low_y + high_y)) / 2
    points = middle + reach * size * rng.uniform(-0.5, 0.5, (count, 2))
    near = rng.random(count) < 1 / 3
    along = shapely.line_interpolate_point(polygon.boundary, rng.random(int(near.sum())), normalized=True)
    places, corners = shapely.get_coordinates(along), shapely.get_coordinates(polygon)
    places[::2] = rng.choice(corners, len(places[::2]))
    points[near] = places + 1e-3 * size * rng.standard_normal(places.shape)
    return points
