"""Standard Denavit-Hartenberg rows and the poses they stand for, as expressions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca

from rehab_opt.errors import ConfigurationError

__all__ = ["DH", "checked_rows", "pose_after", "pose_before", "product"]


class DH(NamedTuple):
    """One standard Denavit-Hartenberg row, A = Rz(theta) Tz(d) Tx(a) Rx(alpha): Eq. (1), Rossa et al.

    The joint value is added to `theta` [rad] of a revolute row and to `d` [m] of a prismatic one.
    """

    a: float
    alpha: float
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False


def checked_rows(rows: object) -> tuple[DH, ...]:
    """`rows` as rows of finite numbers, at least one, or say what is wrong with them."""
    if not isinstance(rows, Sequence) or not rows:
        raise ConfigurationError("rows", rows, "at least one Denavit-Hartenberg row")
    checked = []
    for i, row in enumerate(rows):
        try:
            dh = DH(*row)
            usable = all(math.isfinite(number) for number in dh[:4])
        except (TypeError, ValueError, OverflowError):
            usable = False
        if not usable:
            raise ConfigurationError(
                f"rows[{i}]", row, "finite numbers a, alpha, d, theta, and whether it is prismatic"
            )
        checked.append(dh)
    return tuple(checked)


def pose_after(row: DH, value: ca.SX) -> ca.SX:
    """(4, 4) pose of the frame after a row in the one before it."""
    cos_theta, sin_theta, cos_alpha, sin_alpha, d = _factors(row, value)
    return ca.blockcat(
        [
            [cos_theta, -sin_theta * cos_alpha, sin_theta * sin_alpha, row.a * cos_theta],
            [sin_theta, cos_theta * cos_alpha, -cos_theta * sin_alpha, row.a * sin_theta],
            [0, sin_alpha, cos_alpha, d],
            [0, 0, 0, 1],
        ]
    )


def pose_before(row: DH, value: ca.SX) -> ca.SX:
    """(4, 4) pose of the frame before a row in the one after it, the inverse of `pose_after`."""
    cos_theta, sin_theta, cos_alpha, sin_alpha, d = _factors(row, value)
    return ca.blockcat(
        [
            [cos_theta, sin_theta, 0, -row.a],
            [-sin_theta * cos_alpha, cos_theta * cos_alpha, sin_alpha, -d * sin_alpha],
            [sin_theta * sin_alpha, -cos_theta * sin_alpha, cos_alpha, -d * cos_alpha],
            [0, 0, 0, 1],
        ]
    )


def product(left: ca.SX, right: ca.SX) -> ca.SX:
    """Product of two poses; zeros and ones vanish from the expression."""
    return ca.sparsify(left) @ ca.sparsify(right)


def _factors(row: DH, value: ca.SX) -> tuple[ca.SX, ca.SX, float, float, ca.SX]:
    """Cosine and sine of theta and of alpha, and d, at a joint value."""
    theta, d = (ca.SX(row.theta), row.d + value) if row.prismatic else (row.theta + value, ca.SX(row.d))
    return ca.cos(theta), ca.sin(theta), _exact(math.cos, row.alpha), _exact(math.sin, row.alpha), d


def _exact(function: Callable[[float], float], angle: float) -> float:
    """Sine or cosine with the rounding of multiples of a right angle removed: 1e-17 is zero, and drops out."""
    value = function(angle)
    return float(round(value)) if abs(value - round(value)) < 1e-15 else value
