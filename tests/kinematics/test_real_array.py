"""What counts as a finite number."""

import sys

import numpy as np
import pytest

from rehab_opt.kinematics.real_array import is_finite


@pytest.mark.parametrize("value", [sys.float_info.max, -sys.float_info.max, int(sys.float_info.max), 0, np.float32(1)])
def test_a_number_that_a_float_holds_is_finite(value: object) -> None:
    assert is_finite(value)


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 10**400, -(10**400), True, "1", None])
def test_what_no_float_holds_or_is_no_number_is_not_finite(value: object) -> None:
    assert not is_finite(value)
