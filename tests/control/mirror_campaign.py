"""The manipulability of the UR5 by the closed form."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LARGEST = 0.11987995741622055
"""Of the closed form, by Nelder-Mead over its two angles."""


def closed_form(q: Array) -> float:
    """W of the UR5 over its maximum: |a2 a3 s3 s5 (a2 c2 + a3 c23 + d5 s234)|."""
    a2, a3, d5 = -0.425, -0.39225, 0.09465
    reach = a2 * math.cos(q[1]) + a3 * math.cos(q[1] + q[2]) + d5 * math.sin(q[1] + q[2] + q[3])
    return abs(a2 * a3 * math.sin(q[2]) * math.sin(q[4]) * reach) / LARGEST
