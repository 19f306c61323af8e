"""W_c has two readings: Table I, and the caption of Fig. 3 of Rossa et al. Both against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy.interpolate import RBFInterpolator

from rehab_opt import human_arm, planar_workspace
from rehab_opt.kinematics.human_arm import RANGES_OF_MOTION_DEG
from rehab_opt.workspace.audit import random_points
from rehab_opt.workspace.region import Workspace
from tests.workspace.mapped import mapped, shape
from tests.workspace.slice_oracle import slice_area

TABLE_I = [(180, 180), (0, 5), (70, 90), (30, 70), (30, 60), (30, 60), (-30, -30), (40, 45)]
CAPTION = [(170, 195), (-20, 10), (50, 90), (20, 80), (68, 72), (-50, 60), (-45, -30), (10, 50)]


@pytest.mark.parametrize(("tilt_deg", "cm2"), [(2.0, 33.1), (None, 107.3)])
def test_area_of_table_i_grows_threefold_with_the_tilt_of_the_handle(tilt_deg: float | None, cm2: float) -> None:
    tilt = None if tilt_deg is None else math.radians(tilt_deg)
    found = planar_workspace(human_arm(range_of_motion="restricted"), handle_tilt=tilt, accuracy=1e-3)
    assert 1e4 * found.area == pytest.approx(cm2, rel=0.01)
    counted = slice_area(TABLE_I, (-0.215, 0.445, -0.055, 0.56), pitch=5e-3, tilt_deg=tilt_deg, starts=6)
    assert found.area == pytest.approx(counted, rel=0.05)


def test_caption_of_figure_3_gives_ten_times_the_area_of_table_i() -> None:
    found = shape("figure_3")
    x_min, y_min, x_max, y_max = found.polygon.bounds
    assert 1e4 * found.area == pytest.approx(332.0, rel=0.01)
    assert x_max - x_min == pytest.approx(0.49, abs=0.005)
    assert y_max - y_min == pytest.approx(0.17, abs=0.005)
    assert found.area == pytest.approx(slice_area(CAPTION, (-0.42, 0.29, 0.11, 0.50), pitch=0.012, starts=5), rel=0.05)
    assert found.area > 9.5 * shape("restricted").area


def test_caption_leaves_the_regular_workspace_by_those_two_degrees_alone() -> None:
    regular, caption = shape("regular").polygon, shape("figure_3").polygon
    assert caption.intersection(regular).area / caption.area == pytest.approx(0.948, abs=0.005)
    assert regular.buffer(0.012).contains(caption)
    limits = {joint: np.deg2rad(pair) for joint, pair in RANGES_OF_MOTION_DEG["figure_3"].items()}
    limits["forearm_extension"] = np.deg2rad((68.0, 70.0))
    cut = planar_workspace(human_arm(range_of_motion=limits), accuracy=3e-3).polygon
    assert regular.buffer(4e-3).contains(cut)


# ---------------------------------------------------------------------------------- the published landmark rule on both
def by_scipy(source: Workspace, target: Workspace, lines: int) -> RBFInterpolator:
    """Eqs. (24)-(30) by scipy, through the landmarks of section V."""
    ends = []
    for polygon in (source.polygon, target.polygon):
        centre = np.array(polygon.centroid.coords[0])
        marks = []
        for k in range(1, lines + 1):
            angle = 2 * np.pi * k / lines
            ray = shapely.LineString([centre, centre + math.sqrt(2) * np.array([np.cos(angle), np.sin(angle)])])
            crossed = shapely.get_coordinates(ray.intersection(polygon.boundary))
            marks.append(max(crossed, key=lambda point: float(np.linalg.norm(point - centre))))
        ends.append(np.array(marks))
    return RBFInterpolator(*ends, kernel="thin_plate_spline", degree=1)


@pytest.mark.parametrize(("reading", "folded", "outside"), [("restricted", 0.369, 0.435), ("figure_3", 0.004, 0.046)])
def test_published_rule_folds_on_table_i_and_hardly_on_the_caption(reading: str, folded: float, outside: float) -> None:
    source, target = shape("regular"), shape(reading)
    audit = mapped("regular", reading, rule="polar", landmarks=20).audit(20_000)
    assert audit.folded == pytest.approx(folded, abs=0.003)
    assert audit.outside == pytest.approx(outside, abs=0.004)
    assert not audit.passed
    spline, points, h = by_scipy(source, target, 20), random_points(source, 4000, seed=1), 1e-6
    slopes = [(spline(points + h * axis) - spline(points - h * axis)) / (2 * h) for axis in np.eye(2)]
    determinant = slopes[0][:, 0] * slopes[1][:, 1] - slopes[0][:, 1] * slopes[1][:, 0]
    assert float(np.mean(determinant <= 0)) == pytest.approx(folded, abs=0.02)
    mapped_points = shapely.points(spline(points))
    assert float(np.mean(~shapely.covers(target.polygon, mapped_points))) == pytest.approx(outside, abs=0.025)
