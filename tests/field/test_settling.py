"""The slew limit that fits a spring and a damper, against the loop's gain written out."""

from __future__ import annotations

import pytest
from scipy.optimize import brentq

from rehab_opt.field.settling import LIGHT, OWN_DAMPING, fitting_slew


@pytest.mark.parametrize(("stiffness", "damping"), [(500.0, 0.0), (1500.0, 40.0), (3000.0, 10.0)])
def test_fitting_slew_is_the_force_limit_times_the_frequency_at_which_the_loop_gain_is_one(
    stiffness: float, damping: float
) -> None:
    w = brentq(lambda w: abs(stiffness + 1j * damping * w) / abs(w * (1j * LIGHT * w + OWN_DAMPING)) - 1.0, 1.0, 1e4)
    assert fitting_slew(stiffness, damping, force_limit=30.0, velocity_lag=0.0) == pytest.approx(30.0 * w, rel=1e-9)
