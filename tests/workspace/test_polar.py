"""The published landmarks, Section V: where lines at equal angles leave both contours."""

import numpy as np
import pytest
from shapely import LineString, Point, affinity, box

from rehab_opt.workspace.polar import polar_landmarks
from tests.workspace.mapped import blob, crescent, ell


def test_landmarks_of_discs_are_at_the_angles_of_the_paper():
    small, large = Point(1.0, 2.0).buffer(0.1, quad_segs=256), Point(0.0, 0.0).buffer(0.5, quad_segs=256)
    pairs = polar_landmarks(large, small, landmarks=20)
    angles = 2.0 * np.pi * np.arange(1, 21) / 20.0
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    assert pairs.source == pytest.approx(0.5 * ring, abs=1e-5)
    assert pairs.target == pytest.approx([1.0, 2.0] + 0.1 * ring, abs=1e-5)


def test_a_line_that_leaves_more_than_once_gives_its_furthest_crossing():
    pairs = polar_landmarks(ell(), blob(), landmarks=36)
    centre = np.asarray(ell().centroid.coords[0])
    for point in pairs.source:
        assert ell().exterior.distance(Point(point)) < 1e-12
        beyond = LineString([point + 1e-9 * (point - centre), centre + 10.0 * (point - centre)])
        assert not beyond.intersects(ell().exterior)


def test_rotation_turns_the_lines_of_the_target():
    turned = affinity.rotate(blob(), 0.5, origin="centroid", use_radians=True)
    straight, rotated = (polar_landmarks(blob(), each, rotation=turn) for each, turn in ((blob(), 0.0), (turned, 0.5)))
    assert straight.target == pytest.approx(straight.source, abs=1e-12)
    back = [affinity.rotate(Point(p), -0.5, origin=turned.centroid, use_radians=True) for p in rotated.target]
    assert np.array([(p.x, p.y) for p in back]) == pytest.approx(straight.target, abs=1e-9)


def test_the_best_rotation_finds_a_turned_copy():
    lying = box(0.0, 0.0, 0.3, 0.1).union(box(0.0, 0.0, 0.1, 0.15))
    pairs = polar_landmarks(lying, affinity.rotate(lying, 60.0), landmarks=40, rotation="best")
    z, w = (each @ np.array([1.0, 1.0j]) for each in pairs)
    z, w = z - z.mean(), w - w.mean()
    assert np.degrees(np.angle(np.conj(z) @ w)) == pytest.approx(60.0, abs=1.0)
    assert abs(np.conj(z) @ w) / np.linalg.norm(z) / np.linalg.norm(w) > 0.999


def test_angles_that_miss_a_contour_give_no_pair():
    horseshoe = Point(0.0, 0.0).buffer(1.0).difference(Point(0.0, 0.0).buffer(0.9)).difference(box(0.0, -0.4, 2.0, 0.4))
    assert not horseshoe.contains(horseshoe.centroid)
    assert 3 <= len(polar_landmarks(horseshoe, blob(), landmarks=24).source) < 24
    assert len(polar_landmarks(crescent(), blob(), landmarks=24).source) == len(
        polar_landmarks(blob(), crescent(), landmarks=24).source
    )
