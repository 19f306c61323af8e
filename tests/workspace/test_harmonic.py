"""Meshes, harmonic maps onto the disc, and the map through it that the safe rule starts from."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon, affinity

from rehab_opt.errors import ConfigurationError
from rehab_opt.workspace.harmonic import disc_map, harmonic_images, interpolate
from rehab_opt.workspace.triangulation import grown, inradius, mesh_of, shrunk
from tests.workspace.mapped import blob, crescent, ell, sliver

SHAPES = [crescent(), blob(), ell(), sliver()]


def areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize("polygon", SHAPES)
def test_a_mesh_fills_its_set_with_counterclockwise_triangles(polygon):
    rounded = grown(polygon, 0.03 * np.sqrt(polygon.area))
    mesh = mesh_of(rounded, float(np.sqrt(rounded.area / 1000)))
    each = areas(mesh.points, mesh.triangles)
    assert (each > 0.0).all()
    outline = Polygon(mesh.points[: mesh.boundary])
    assert each.sum() == pytest.approx(outline.area, rel=1e-9)
    assert outline.area == pytest.approx(rounded.area, rel=5e-3)


@pytest.mark.parametrize("polygon", SHAPES)
def test_no_triangle_is_flipped_on_the_way_to_the_disc(polygon):
    rounded = grown(polygon, 0.03 * np.sqrt(polygon.area))
    disc = disc_map(mesh_of(rounded, float(np.sqrt(rounded.area / 1500))))
    assert (areas(disc.images, disc.mesh.triangles) > 0.0).all()
    assert np.linalg.norm(disc.images, axis=1).max() <= 1.0 + 1e-12


def test_the_harmonic_map_of_a_disc_is_the_disc_itself():
    mesh = mesh_of(Point(3.0, 1.0).buffer(0.2, quad_segs=200), 0.008)
    start = np.arctan2(*(mesh.points[0] - [3.0, 1.0])[::-1])
    turn = np.array([[np.cos(start), -np.sin(start)], [np.sin(start), np.cos(start)]])
    assert disc_map(mesh).images == pytest.approx((mesh.points - [3.0, 1.0]) / 0.2 @ turn, abs=2e-3)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_affine_data_are_carried_exactly(seed):
    random = np.random.default_rng(seed)
    mesh = mesh_of(blob(), 0.006)
    matrix = random.normal(size=(2, 2))
    inside = mesh.points[random.integers(len(mesh.points), size=(20, 3))].mean(axis=1)
    inside = inside[[blob().buffer(-0.001).contains(Point(p)) for p in inside]]
    assert interpolate(mesh.points, mesh.triangles, mesh.points @ matrix, inside) == pytest.approx(
        inside @ matrix, abs=1e-12
    )


@pytest.mark.parametrize("turn", [0.0, 1.0, -2.5])
def test_a_set_and_its_turned_copy_are_matched_point_by_point_also_where_the_best_rotation_is_sought(turn):
    turned = affinity.rotate(ell(), turn, origin=(0.0, 0.0), use_radians=True)
    points = mesh_of(ell(), 0.03).points
    (images,) = harmonic_images(ell(), turned, points, turn)
    c, s = np.cos(turn), np.sin(turn)
    apart = images - points @ np.array([[c, s], [-s, c]])
    assert np.linalg.norm(apart, axis=1).max() < 0.01
    best = harmonic_images(ell(), turned, points, "best")
    assert min(np.linalg.norm(apart + each - images, axis=1).max() for each in best) < 0.01


@pytest.mark.parametrize("polygon", SHAPES)
def test_grown_and_shrunk_sets_keep_their_distance(polygon):
    by = 0.05 * inradius(polygon)
    assert grown(polygon, by).contains(polygon.buffer(0.99 * by))
    narrow = shrunk(polygon, by)
    assert narrow.geom_type == "Polygon"
    assert polygon.buffer(-0.98 * by).contains(narrow)
    assert narrow.area > 0.7 * polygon.area


def test_shrinking_that_would_tear_a_set_apart_is_reduced():
    waist = (
        Point(0.0, 0.0)
        .buffer(0.1)
        .union(Point(0.3, 0.0).buffer(0.1))
        .union(Polygon([(0.0, -0.01), (0.3, -0.01), (0.3, 0.01), (0.0, 0.01)]))
    )
    narrow = shrunk(waist, 0.02)
    assert narrow.geom_type == "Polygon"
    assert narrow.area > 0.9 * waist.area
    with pytest.raises(ConfigurationError):
        shrunk(Polygon([(0.0, 0.0), (1.0, 0.0), (1.0, 1e-7)]), 0.1)
