"""A map between workspaces: exact inverse, equal power, defined everywhere, and refused where none can exist."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon, Point, Polygon, affinity, box

from rehab_opt.workspace.audit import random_points
from rehab_opt.workspace.mapping import WorkspaceMap
from tests.refusals import refuses
from tests.workspace.mapped import blob, mapped, shape, workspace

WAYS = [("regular", "restricted"), ("restricted", "regular"), ("crescent", "blob")]
RING = workspace(Point(0.0, 0.0).buffer(0.2).difference(Point(0.0, 0.0).buffer(0.1)))
TWO = workspace(MultiPolygon([box(0.0, 0.0, 0.1, 0.1), box(0.2, 0.0, 0.3, 0.1)]))
EMPTY = workspace(Polygon())


@pytest.mark.parametrize("way", WAYS)
def test_the_inverse_returns_every_point(way):
    made = mapped(*way)
    points = random_points(made.source, 2000, 1)
    assert np.linalg.norm(made.inverse(made(points)) - points, axis=1).max() <= 1e-9
    one = points[0]
    assert made.inverse(made(one)) == pytest.approx(one, abs=1e-9)


def test_what_is_no_image_has_no_inverse():
    made = mapped("regular", "restricted")
    far = np.array([[5.0, 5.0], [np.nan, 0.0], made(random_points(made.source, 1, 0))[0]])
    assert np.isnan(made.inverse(far)).all(axis=1).tolist() == [True, True, False]


@pytest.mark.parametrize("way", WAYS)
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_force_and_motion_carry_the_same_power_on_both_sides(way, seed, fx, fy):
    made = mapped(*way)
    (point,) = random_points(made.source, 1, seed)
    force, velocity = np.array([fx, fy]), np.random.default_rng(seed).normal(size=2)
    step = 1e-7
    moved = (made.spline(point + step * velocity) - made.spline(point - step * velocity)) / (2.0 * step)
    assert (made.jacobian(point).T @ force) @ velocity == pytest.approx(force @ moved, rel=1e-5, abs=1e-6)


def test_a_point_outside_counts_as_the_nearest_of_the_source():
    made = mapped("crescent", "blob")
    outside = np.array([[0.5, 0.5], [0.02, -0.05], [-9.0, 0.0]])
    assert not made.source.contains(outside).any()
    for point in outside:
        assert made(point) == pytest.approx(made(made.source.nearest(point)), abs=1e-12)
    assert made.target.contains(made(outside)).all()
    assert outside[0].tolist() == [0.5, 0.5]  # the caller's array is untouched


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.0])
def test_directions_turn_by_the_wanted_rotation(turn):
    wide = affinity.scale(blob(), 3.0, 3.0)
    made = WorkspaceMap.between(
        workspace(wide), workspace(affinity.rotate(blob(), turn, use_radians=True)), rotation=turn
    )
    assert made.rotation == pytest.approx(turn, abs=np.radians(3.0))
    # A set mapped onto a smaller, turned copy of itself is hardly distorted at all.
    audit = made.audit(2000)
    assert audit.passed
    assert audit.max_stretch / audit.min_stretch < 1.3


@pytest.mark.parametrize("rule", ["safe", "polar"])
def test_pairs_without_a_one_to_one_map_are_refused_by_name(rule):
    refuses(
        lambda source, target: WorkspaceMap.between(source, target, rule=rule),
        ((EMPTY, shape("blob")), "source = ", "not empty"),
        ((shape("blob"), EMPTY), "target = ", "not empty"),
        ((TWO, shape("blob")), "source = ", "source has 2 components, target 1"),
        ((shape("blob"), TWO), "target = ", "source has 1 component, target 2"),
        ((RING, shape("blob")), "source = ", "source has 1 hole, target 0"),
        ((shape("blob"), RING), "target = ", "source has 0 holes, target 1"),
        ((RING, RING), "source = ", "source has 1 hole, target 1"),
    )


def test_what_cannot_be_used_is_refused_by_name_and_points_are_never_read_as_others():
    refuses(
        partial(WorkspaceMap.between, shape("blob"), shape("ell")),
        ({"rule": "conformal"}, "rule = "),
        ({"landmarks": 2, "rule": "polar"}, "landmarks = "),
        ({"landmarks": 20}, "landmarks = "),
        ({"rotation": np.nan}, "rotation = "),
        ({"rotation": "worst"}, "rotation = "),
    )
    made = mapped("regular", "restricted")
    points = [np.zeros((2, 3)), np.zeros(4), np.zeros((2, 1, 2)), [0.0], "ab", [None, 0.0]]
    for method in (made, made.jacobian, made.inverse):
        refuses(method, *(((each,), "points = ") for each in points))
