"""Numbers as callers give them."""

from __future__ import annotations

import math

import numpy as np

__all__ = ["real_number"]


def real_number(value: object) -> float:
    """`value` as a float; NaN, which fails every comparison, for what is no number: strings, None, bools, arrays."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits
        return math.inf if value > 0 else -math.inf
