"""Slices of arms that move far: starts from which the programme's linearised rows have no common point."""

import math

import numpy as np
import pytest
import shapely

from rehab_opt import DH, SerialChain, human_arm
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.workspace.plane_approach import PlaneApproach
from rehab_opt.workspace.plane_search import PlaneSearch
from rehab_opt.workspace.plane_statement import PlaneStatement, spread_postures
from rehab_opt.workspace.reach import planar_workspace

TILTS = [None, math.radians(2.0), 0.0]


@pytest.fixture(scope="module")
def wide_arm() -> SerialChain:
    return human_arm(range_of_motion=dict.fromkeys(ARM_JOINTS, (-2.1, 2.1)))


@pytest.mark.parametrize("tilt", TILTS)
def test_spread_postures_of_a_wide_range_lead_to_the_slice(wide_arm: SerialChain, tilt: float | None) -> None:
    search = PlaneSearch(PlaneStatement(wide_arm, handle_tilt=tilt), height=-0.24, compile=False)
    found = search.spread(64)
    assert len(found) >= 45
    for each in found:
        pose = wide_arm.pose(each.posture)
        assert np.allclose(pose[:3, 3], [each.x, each.y, -0.24], atol=1e-6)
        assert tilt is None or math.atan2(math.hypot(*pose[:2, 0]), pose[2, 0]) <= tilt + 1e-6
        assert np.all((wide_arm.lower <= each.posture) & (each.posture <= wide_arm.upper))


def test_a_probe_near_a_folded_elbow_finds_its_nearest_point_from_anywhere() -> None:
    links = (DH(0.2, 0.0), DH(0.19, 0.0))
    arm = SerialChain(links, lower=[-math.inf] * 2, upper=[math.inf] * 2, velocity=1.0, acceleration=1.0)  # type: ignore[arg-type]
    search = PlaneSearch(PlaneStatement(arm, handle_tilt=None), height=0.0, compile=False)
    for x in (0.0085, 0.0101, 0.02):
        answers = [search.nearest(x, 0.0, start) for start in spread_postures(arm, np.arange(2), 16)]
        found = [answer.distance for answer in answers if answer is not None]
        assert np.sum(np.abs(np.array(found) - max(0.0, 0.01 - x)) < 1e-6) >= 14


def test_a_small_hole_around_the_base_is_one_hole() -> None:
    other = 0.196
    links = (DH(0.2, 0.0), DH(other, 0.0))
    arm = SerialChain(links, lower=[-math.inf] * 2, upper=[math.inf] * 2, velocity=1.0, acceleration=1.0)  # type: ignore[arg-type]
    workspace = planar_workspace(arm, height=0.0, handle_tilt=None, accuracy=2e-3)
    assert (workspace.components, workspace.holes, workspace.accuracy) == (1, 1, 2e-3)
    hole = shapely.Polygon(workspace.polygon.interiors[0])
    radius = 0.2 - other
    assert abs(hole.area - math.pi * radius**2) < 0.05 * math.pi * radius**2


def test_a_wide_range_reaches_one_region_of_the_accuracy_asked_for(wide_arm: SerialChain) -> None:
    workspace = planar_workspace(wide_arm, handle_tilt=None, accuracy=0.02, resolution=0.05)
    assert (workspace.components, workspace.holes, workspace.accuracy) == (1, 0, 0.02)


@pytest.mark.parametrize("tilt", TILTS)
def test_an_approach_stays_within_the_limits_and_never_ends_further_off(
    wide_arm: SerialChain, tilt: float | None
) -> None:
    statement = PlaneStatement(wide_arm, handle_tilt=tilt)
    approach = PlaneApproach(statement)
    parameters = np.concatenate([statement.fixed, [-0.24, 0.3, 0.35, statement.size**-2]])
    starts = spread_postures(wide_arm, statement.free, 32)
    found = approach.near(parameters, np.tile([0.3, 0.35], (32, 1)), starts)
    arrived = 0
    for start, x, hand, distance, miss in zip(starts, *found, strict=True):
        assert np.all((wide_arm.lower <= x) & (x <= wide_arm.upper))
        pose = wide_arm.pose(x)
        assert np.allclose(pose[:2, 3], hand, atol=1e-9)
        assert math.dist(hand, (0.3, 0.35)) == pytest.approx(distance, abs=1e-9)
        assert abs(pose[2, 3] + 0.24) <= miss + 1e-9
        off, before = (np.linalg.norm(statement.approach(each, parameters).full()) for each in (x, start))
        assert off <= 20 * before  # of the last round's, where plane and handle count twenty times as much
        arrived += off < 1e-4
    assert arrived >= 20


def test_an_approach_from_what_is_no_number_comes_to_an_end(wide_arm: SerialChain) -> None:
    statement = PlaneStatement(wide_arm, handle_tilt=None)
    parameters = np.concatenate([statement.fixed, [math.nan, 0.3, 0.35, 1.0]])
    found = PlaneApproach(statement).near(parameters, np.array([[0.3, 0.35]]), np.full((1, 8), math.nan))
    assert np.isnan(found.postures).all()


def test_a_cone_that_leaves_out_next_to_nothing_is_as_good_as_none() -> None:
    arm = human_arm(range_of_motion="restricted")
    free, almost = (planar_workspace(arm, handle_tilt=t, accuracy=4e-3) for t in (None, math.pi - 1e-7))
    assert almost.accuracy == 4e-3
    assert almost.polygon.symmetric_difference(free.polygon).area < 0.01 * free.area
