"""W_c has two readings: Table I, and the caption of Fig. 3 of Rossa et al."""

from __future__ import annotations

import numpy as np
import pytest

from rehab_opt import human_arm, planar_workspace
from rehab_opt.kinematics.human_arm import RANGES_OF_MOTION_DEG
from tests.workspace.mapped import mapped, shape


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
