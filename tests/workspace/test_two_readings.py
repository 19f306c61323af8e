"""W_c has two readings: Table I, and the caption of Fig. 3 of Rossa et al."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rehab_opt import human_arm, planar_workspace
from rehab_opt.kinematics.human_arm import RANGES_OF_MOTION_DEG
from tests.workspace.mapped import mapped, shape


@pytest.mark.parametrize(
    ("tilt_deg", "cm2"),
    [
        (2.0, 33.1),
        *(pytest.param(*each, marks=pytest.mark.nightly) for each in ((5.0, 44.2), (10.0, 63.3), (20.0, 102.0))),
        (None, 107.3),
    ],
)
def test_area_of_table_i_grows_threefold_with_the_tilt_of_the_handle(tilt_deg: float | None, cm2: float) -> None:
    tilt = None if tilt_deg is None else math.radians(tilt_deg)
    found = planar_workspace(human_arm(range_of_motion="restricted"), handle_tilt=tilt, accuracy=1e-3)
    assert 1e4 * found.area == pytest.approx(cm2, rel=0.01)


def test_caption_of_figure_3_gives_ten_times_the_area_of_table_i() -> None:
    found = shape("figure_3")
    x_min, y_min, x_max, y_max = found.polygon.bounds
    assert 1e4 * found.area == pytest.approx(332.0, rel=0.01)
    assert x_max - x_min == pytest.approx(0.49, abs=0.005)
    assert y_max - y_min == pytest.approx(0.17, abs=0.005)
    assert found.area > 9.5 * shape("restricted").area


def test_caption_leaves_the_regular_workspace_by_those_two_degrees_alone() -> None:
    regular, caption = shape("regular").polygon, shape("figure_3").polygon
    assert caption.intersection(regular).area / caption.area == pytest.approx(0.948, abs=0.005)
    assert regular.buffer(0.012).contains(caption)
    limits = {joint: np.deg2rad(pair) for joint, pair in RANGES_OF_MOTION_DEG["figure_3"].items()}
    limits["forearm_extension"] = np.deg2rad((68.0, 70.0))
    cut = planar_workspace(human_arm(range_of_motion=limits), accuracy=3e-3).polygon
    assert regular.buffer(4e-3).contains(cut)


@pytest.mark.parametrize(("reading", "folded", "outside"), [("restricted", 0.369, 0.435), ("figure_3", 0.004, 0.046)])
def test_published_rule_folds_on_table_i_and_hardly_on_the_caption(reading: str, folded: float, outside: float) -> None:
    audit = mapped("regular", reading, rule="polar", landmarks=20).audit(20_000)
    assert audit.folded == pytest.approx(folded, abs=0.003)
    assert audit.outside == pytest.approx(outside, abs=0.004)
    assert not audit.passed
