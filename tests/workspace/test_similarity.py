"""The largest copy of a drawing: known where it is known in closed form, and never outside."""

import math

import numpy as np
import pytest
from shapely import LineString, Point, affinity, box

from rehab_opt.workspace.similarity import largest_copy
from tests.refusals import refuses
from tests.workspace.mapped import ell, shape, workspace

TURN = np.linspace(0.0, 2.0 * np.pi, 200)
CIRCLE = np.column_stack([np.cos(TURN), np.sin(TURN)])
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
BLOB = shape("blob")
EIGHT = np.column_stack([np.sin(TURN), 0.5 * np.sin(2.0 * TURN)])


@pytest.mark.parametrize(
    ("path", "target", "scale"),
    [
        (CIRCLE, box(3.0, 1.0, 3.4, 2.0), 0.2),
        (3.0 + CIRCLE, affinity.scale(Point(0.0, 0.0).buffer(1.0, quad_segs=60), 0.5, 0.3), 0.3),
        (SQUARE, affinity.rotate(box(0.0, 0.0, 0.3, 0.3), 33.0), 0.3),
        (np.array([[0.0, 0.0], [1.0, 0.0]]), box(0.0, 0.0, 0.3, 0.4), 0.5),
        (CIRCLE, ell(), 0.1 * (2.0 - math.sqrt(2.0))),
    ],
)
def test_the_copy_is_as_large_as_geometry_allows(path, target, scale):
    found = largest_copy(path, workspace(target))
    assert 0.985 * scale <= found.scale <= (1.0 + 1e-6) * scale
    assert target.buffer(1e-9).covers(LineString(found(path)))


def test_a_given_turn_and_margin_are_kept():
    target = box(0.0, 0.0, 0.4, 0.2)
    found = largest_copy(SQUARE, workspace(target), rotation=math.pi / 4.0)
    assert found.turn == math.pi / 4.0
    assert found.scale == pytest.approx(0.2 / math.sqrt(2.0), rel=0.015)
    narrow = largest_copy(SQUARE, workspace(target), margin=0.02)
    assert narrow.scale == pytest.approx(0.16, rel=0.015)
    assert target.exterior.distance(LineString(narrow(SQUARE))) >= 0.02 - 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_drawings_are_inside_sets_that_are_not_convex_and_random_copies_are_no_larger(seed):
    random, target = np.random.default_rng(seed), shape("crescent")
    path = np.cumsum(random.normal(size=(40, 2)), axis=0)
    found = largest_copy(path, target)
    assert target.polygon.covers(LineString(found(path)))
    for _ in range(300):
        turn, middle = random.uniform(0.0, 2.0 * np.pi), random.uniform(*np.reshape(target.polygon.bounds, (2, 2)))
        c, s = 1.05 * found.scale * np.cos(turn), 1.05 * found.scale * np.sin(turn)
        other = (path - path.mean(axis=0)) @ np.array([[c, s], [-s, c]]) + middle
        assert not target.polygon.covers(LineString(other))


def test_what_cannot_be_used_is_refused_by_name():
    refuses(
        lambda path=EIGHT, target=BLOB, **given: largest_copy(path, target, **given),
        ({"path": [[0.0, 0.0], [0.0, 0.0]]}, "path = "),
        ({"path": [[0.0, math.nan], [0.0, 0.0]]}, "path = "),
        ({"path": [0.0, 1.0]}, "path = "),
        ({"rotation": "left"}, "rotation = "),
        ({"margin": 1.0}, "margin = "),
        ({"margin": -0.1}, "margin = "),
        ({"target": workspace(Point(0, 0).buffer(1.0).difference(Point(0, 0).buffer(0.5)))}, "target = "),
    )
