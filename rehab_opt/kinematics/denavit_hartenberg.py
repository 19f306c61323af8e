"""Standard Denavit-Hartenberg rows as links of a serial chain."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import casadi as ca

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.link import ChainRow, Link

__all__ = ["DH", "FASTEST", "SIX_TURNS", "TWO_TURNS", "checked_rows", "exact"]

TWO_TURNS = 4 * math.pi
"""[rad] Largest accepted joint angle, and largest usual joint motion in 1 s. A larger angle is in degrees, or a limit
that means "no limit"."""

SIX_TURNS = 3 * TWO_TURNS
"""[rad/s] Largest accepted joint speed: human joints and arms within their makers' limits are slower. A larger speed is
in degrees per second."""

FASTEST = 10.0
"""[m/s] Largest accepted speed of a joint that slides. A larger speed is in millimetres per second."""


class DH(NamedTuple):
    """One standard Denavit-Hartenberg row, A = Rz(theta) Tz(d) Tx(a) Rx(alpha): Eq. (1), Rossa et al.

    The joint value is added to `theta` [rad] of a revolute row and to `d` [m] of a prismatic one.
    """

    a: float
    alpha: float
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False

    @property
    def after(self) -> ca.SX | ca.DM:
        """(4, 4) transform A at joint value zero; the joint's motion about or along z commutes with Rz(theta) Tz(d)."""
        cos, sin = exact(math.cos, self.theta), exact(math.sin, self.theta)
        cos_alpha, sin_alpha = exact(math.cos, self.alpha), exact(math.sin, self.alpha)
        return ca.blockcat(
            [
                [cos, -sin * cos_alpha, sin * sin_alpha, self.a * cos],
                [sin, cos * cos_alpha, -cos * sin_alpha, self.a * sin],
                [0, sin_alpha, cos_alpha, self.d],
                [0, 0, 0, 1],
            ]
        )

    @property
    def along(self) -> float:
        """[m] d: offset of the next frame along the joint's axis."""
        return self.d

    @property
    def across(self) -> float:
        """[m] |a|: distance of the next frame from the joint's axis."""
        return abs(self.a)

    @property
    def lengths(self) -> tuple[float, ...]:
        """[m] the nonzero values of a and d."""
        return tuple(length for length in (self.a, self.d) if length != 0.0)

    def with_lengths(self, lengths: Iterator[Any]) -> DH:
        """The same row, but its nonzero a and d are the next entries of `lengths`, numbers or expressions."""
        a = next(lengths) if self.a != 0.0 else 0.0
        return self._replace(a=a, d=next(lengths) if self.d != 0.0 else 0.0)


def checked_rows(rows: object) -> tuple[ChainRow, ...]:
    """The rows, after a check that there is at least one and all numbers are finite; else `ConfigurationError`."""
    if not isinstance(rows, Sequence) or not rows:
        raise ConfigurationError("rows", rows, "at least one Denavit-Hartenberg row or Link")
    checked: list[ChainRow] = []
    for i, row in enumerate(rows):
        if isinstance(row, Link):
            checked.append(row)
            continue
        try:
            dh = DH(*row)
            valid = all(math.isfinite(number) for number in dh[:4])
            turned = valid and max(abs(dh.alpha), abs(dh.theta)) > TWO_TURNS
        except (TypeError, ValueError, OverflowError):
            valid = False
        if not valid:
            expected = "finite numbers a, alpha, d, theta, and whether it is prismatic; or a Link"
            raise ConfigurationError(f"rows[{i}]", row, expected)
        if turned:
            raise ConfigurationError(f"rows[{i}]", row, "alpha and theta in radians, within two turns")
        checked.append(dh)
    return tuple(checked)


def exact(function: Callable[[float], float], angle: float) -> float:
    """Sine or cosine that is exact at multiples of 90 degrees, so that zeros vanish from expressions."""
    value = function(angle)
    return float(round(value)) if abs(value - round(value)) < 1e-15 else value
