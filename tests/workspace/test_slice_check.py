"""The check behind a stated accuracy: it finds what is wrong with a polygon, and what is not repaired is stated."""

import itertools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from rehab_opt import DH, ArmIK, SerialChain, human_arm
from rehab_opt.workspace import slice_search
from rehab_opt.workspace.contour import contours
from rehab_opt.workspace.lattice import Node
from rehab_opt.workspace.plane_search import PlaneSearch
from rehab_opt.workspace.plane_statement import PlaneStatement
from rehab_opt.workspace.reach import slice_at
from rehab_opt.workspace.slice_search import SliceSearch

ACCURACY = 4e-3
ARM = SerialChain(
    (DH(0.3, 0.0), DH(0.2, 0.0)), lower=[0.0, 0.5], upper=[1.0, 2.5], velocity=1.0, acceleration=1.0  # type: ignore[arg-type]
)  # fmt: skip


@pytest.fixture(scope="module")
def searched() -> tuple[SliceSearch, BaseGeometry]:
    search = PlaneSearch(PlaneStatement(ARM, handle_tilt=None), height=0.0)
    found = SliceSearch(search, search.spread(64), accuracy=ACCURACY, resolution=None)
    found.fill()
    found.surround()
    return found, found.polygon()


@pytest.mark.parametrize(("others", "rings"), [(0.8, 1), (1.2, 2)])
@pytest.mark.parametrize("inside", [((0, 0), (1, 1)), ((1, 0), (0, 1))])
def test_nodes_across_a_cell_are_joined_where_its_middle_is_within_the_level(
    inside: tuple[tuple[int, int], ...], others: float, rings: int
) -> None:
    keys = itertools.product(range(-1, 3), repeat=2)
    nodes = {key: Node(0.0 if key in inside else others, *key, None) for key in keys}
    lattice: Any = SimpleNamespace(nodes=nodes, spacing=1.0)
    found = [shapely.LinearRing([crossing[:2] for crossing in ring]) for ring in contours(lattice, 0.5)]
    assert [ring.is_ccw for ring in found] == [True] * rings


def bite(polygon: BaseGeometry) -> BaseGeometry:
    return polygon.difference(polygon.exterior.interpolate(0.3, normalized=True).buffer(2 * ACCURACY))


def bump(polygon: BaseGeometry) -> BaseGeometry:
    return polygon.union(polygon.exterior.interpolate(0.3, normalized=True).buffer(2 * ACCURACY))


def slit(polygon: BaseGeometry) -> BaseGeometry:
    """Narrower than a probe's distance from both of its sides."""
    x, y = polygon.representative_point().coords[0]
    return polygon.difference(shapely.LineString([(x - 0.01, y), (x + 0.01, y)]).buffer(ACCURACY / 4))


def hole(polygon: BaseGeometry) -> BaseGeometry:
    return polygon.difference(polygon.representative_point().buffer(2 * ACCURACY))


def test_the_polygon_found_stands_its_check(searched: tuple[SliceSearch, BaseGeometry]) -> None:
    search, polygon = searched
    wrong, probes = search.contradictions(polygon, 0.9 * ACCURACY)
    assert not wrong
    assert probes > 100


@pytest.mark.parametrize("spoil", [bite, bump, slit, hole])
def test_what_is_wrong_with_a_polygon_is_found_where_it_is(
    searched: tuple[SliceSearch, BaseGeometry], spoil: Callable[[BaseGeometry], BaseGeometry]
) -> None:
    search, polygon = searched
    spoiled = spoil(polygon)
    wrong, _ = search.contradictions(spoiled, 0.9 * ACCURACY)
    assert wrong
    spoils = spoiled.symmetric_difference(polygon)
    assert max(spoils.distance(shapely.Point(x, y)) for x, y, _ in wrong) <= ACCURACY


@pytest.mark.parametrize("spoil", [bite, bump])
def test_what_is_not_repaired_raises_the_accuracy_that_is_stated(
    monkeypatch: pytest.MonkeyPatch, spoil: Callable[[BaseGeometry], BaseGeometry]
) -> None:
    true = SliceSearch.polygon
    monkeypatch.setattr(SliceSearch, "polygon", lambda self: spoil(true(self)))
    found = slice_at(ARM, height=0.0, handle_tilt=None, accuracy=ACCURACY)
    assert found.solves > found.probes > 100, "each probe is a solve, and so is each start of the search"
    assert found.failed > 0
    assert found.accuracy == 2 * ACCURACY or found.accuracy == 4 * ACCURACY


def test_what_is_wrong_once_is_looked_at_again(monkeypatch: pytest.MonkeyPatch) -> None:
    true, calls = SliceSearch.polygon, []

    def polygon(self: SliceSearch) -> BaseGeometry:
        calls.append(1)
        return bite(true(self)) if len(calls) == 1 else true(self)

    monkeypatch.setattr(SliceSearch, "polygon", polygon)
    found = slice_at(ARM, height=0.0, handle_tilt=None, accuracy=ACCURACY)
    assert (len(calls), found.failed, found.accuracy) == (2, 0, ACCURACY)


def test_nodes_called_unreachable_by_mistake_are_repaired(searched: tuple[SliceSearch, BaseGeometry]) -> None:
    search, polygon = searched
    inside = polygon.representative_point()
    x, y = search.fine_spacing * np.round(np.array(inside.coords[0]) / search.fine_spacing)
    lattice = search.fine
    before = dict(lattice.nodes)
    posture = search._reached(np.array([[x, y]]), slice_search.MANY)[1][0]
    lattice.offer((key, posture) for key in lattice.keys_around(x, y))
    for key in lattice.keys_around(x, y):
        lattice.nodes[key].distance = 1e-4  # as a local minimum would have it
    search.repair([(float(x), float(y), posture)])
    assert all(lattice.nodes[key].distance == 0.0 for key in lattice.keys_around(x, y))
    assert len(lattice.nodes) >= len(before)
    assert math.isclose(search.polygon().area, polygon.area, rel_tol=1e-3)


def test_a_local_minimum_cuts_no_notch_into_the_boundary() -> None:
    """The programme was certified 1.6 mm inside, at a corner of another sheet: a notch as deep, accurate to 1 mm."""
    deg = {
        "scapular_retraction": (-11.63, 17.55),
        "glenohumeral_rotation": (-18.85, 10.63),
        "shoulder_adduction": (52.89, 84.28),
        "humeral_flexion": (14.44, 84.84),
        "forearm_extension": (-0.46, 71.26),
        "wrist_flexion": (-55.91, 56.27),
        "wrist_deviation": (-55.79, -24.75),
        "wrist_supination": (6.29, 58.93),
    }
    arm = human_arm(
        range_of_motion={name: (math.radians(low), math.radians(high)) for name, (low, high) in deg.items()},
        segments={"acromiohumeral": 0.1354, "humerus": 0.2746, "forearm": 0.3191, "hand": 0.0667},
        side="right",
    )
    height, tilt = -0.24, math.radians(2)
    found = slice_at(arm, height=height, handle_tilt=tilt, accuracy=1e-3)
    assert found.accuracy == 1e-3
    assert found.failed == 0
    arm_ik = ArmIK(arm, handle_tilt=tilt)
    reached = [
        point
        for point in itertools.product(np.linspace(-0.078, -0.073, 6), np.linspace(0.402, 0.406, 9))
        if arm_ik.solve([*point, height]).status.certified
    ]
    assert len(reached) > 30
    assert max(found.polygon.distance(shapely.Point(point)) for point in reached) <= 0.2e-3
