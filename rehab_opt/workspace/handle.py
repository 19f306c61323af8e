"""The handle as rows of a nonlinear programme: the last frame's x axis within a tilt of vertical."""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.optim.rows import Row, equal, within

__all__ = ["ALMOST_EXACT", "beyond_cone", "handle_kind", "handle_rows"]

ALMOST_EXACT = 1e-5
"""[rad] Below this tilt the cone's normal vanishes, and the handle is aligned exactly instead."""


def handle_kind(handle_tilt: float | None) -> str:
    """Which of the ways to write the handle's rows a tilt [rad] takes."""
    if handle_tilt is None or handle_tilt >= np.pi:
        return "free"
    if handle_tilt < ALMOST_EXACT:
        return "line"
    return "cone" if handle_tilt <= np.pi / 2 else "wide cone"


def handle_rows(axis: ca.SX, tilt: ca.SX, handle_tilt: float | None) -> list[Row]:
    """Rows that hold the handle axis within `tilt` of +z0.

    The cone x_n . z_0 >= cos(tilt), up to 90 deg over sin(tilt) so that its unit is the radian. Exact alignment: both
    horizontal components zero, which leaves the sign open, so the vertical one is not negative.

    Never posed through Euler angles: Eqs. (4)-(5), Rossa et al., are singular exactly at their own goal.
    """
    kind = handle_kind(handle_tilt)
    if kind == "free":
        return []
    if kind == "line":
        return [equal(axis[:2], ca.SX.zeros(2)), within(axis[2], 0.0, ca.inf)]
    # Below horizontal the unit does not matter, and almost straight down the sine would blow the row up.
    slope = ca.sin(tilt) if kind == "cone" else 1.0
    return [within((axis[2] - ca.cos(tilt)) / slope, 0.0, ca.inf)]


def beyond_cone(axis: ca.SX, tilt: ca.SX) -> ca.SX:
    """(3,) what is left of axis - z0 beyond the cone, in rad where it is small; zero inside, and never without a slope.

    For least squares, which have no use for an inequality.
    """
    off = axis - ca.vertcat(0, 0, 1)
    length = ca.sqrt(ca.sumsqr(off) + 1e-20)
    return off * ca.fmax(0, 1 - 2 * ca.sin(tilt / 2) / length)
