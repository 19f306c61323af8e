"""Motion of independent axes in pieces of constant jerk: bounds, position range and time-optimal stop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["AxisBounds", "AxisStop", "Piece", "axis_bounds", "planned_range", "position_range", "stopping_distance"]

MAX_AXES = 10_000


class AxisBounds(NamedTuple):
    """Bounds (n,) on position [u], velocity [u/s], acceleration [u/s^2] and jerk [u/s^3] of n axes; u is rad or m."""

    lower: list[float]
    upper: list[float]
    velocity: list[float]
    acceleration: list[float]
    jerk: list[float]


def axis_bounds(
    *,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    axes: int | None = None,
) -> AxisBounds:
    """Check the bounds of all axes; a scalar applies to every axis, and None means no bound."""
    given = {
        "lower": -math.inf if lower is None else lower,
        "upper": math.inf if upper is None else upper,
        "velocity": velocity,
        "acceleration": acceleration,
        "jerk": jerk,
    }
    n = axes if axes is not None else max(checked_array(name, value, "numbers").size for name, value in given.items())
    if not (isinstance(n, (int, np.integer)) and not isinstance(n, bool) and 1 <= n <= MAX_AXES):
        raise ConfigurationError("axes", axes, f"a whole number of axes from 1 to {MAX_AXES}")
    bounds = AxisBounds(**{name: per_joint(name, value, n).tolist() for name, value in given.items()})
    for name in ("velocity", "acceleration", "jerk"):
        if not all(0.0 < number < math.inf for number in getattr(bounds, name)):
            raise ConfigurationError(name, given[name], "positive finite numbers")
    for low, high in zip(bounds.lower, bounds.upper, strict=True):
        if not (low <= high and low < math.inf and high > -math.inf):
            raise ConfigurationError("lower, upper", (low, high), "lower <= upper, neither NaN")
    return bounds


class Piece(NamedTuple):
    """An interval of constant jerk and the state at its start; u is rad or m."""

    seconds: float
    position: float
    velocity: float
    acceleration: float
    jerk: float

    def after(self, t: float) -> tuple[float, float, float]:
        """Position [u], velocity [u/s] and acceleration [u/s^2], `t` seconds after the piece began."""
        _, p, v, a, j = self
        return p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j

    def turns(self) -> list[float]:
        """Times [s] of zero velocity within the piece: roots of v + a t + j t^2 / 2."""
        _, _, v, a, j = self
        discriminant = a * a - 2.0 * j * v
        if not discriminant >= 0.0:
            return []
        q = -(a + math.copysign(math.sqrt(discriminant), a))  # avoids the difference of nearly equal numbers
        roots = [q / j] if j else []
        roots += [2.0 * v / q] if q else []
        return [t for t in roots if 0.0 < t < self.seconds]


def position_range(pieces: Sequence[Piece]) -> tuple[float, float]:
    """Smallest and largest position [u] of a motion; they occur at ends of pieces or where the velocity reverses."""
    positions = [piece.after(t)[0] for piece in pieces for t in (0.0, *piece.turns(), piece.seconds)]
    return min(positions), max(positions)


def stopping_distance(speed: float, acceleration: float, jerk: float) -> float:
    """Signed stopping distance [u] of an axis that moves at a constant `speed` [u/s]."""
    v = abs(speed)
    seconds = v / acceleration + acceleration / jerk if v * jerk >= acceleration**2 else 2.0 * math.sqrt(v / jerk)
    return 0.5 * speed * seconds


def planned_range(profile: Any, extent: Any) -> tuple[float, float]:
    """Smallest and largest position [u] of one axis during a Ruckig profile, including positions at reversals."""
    v = profile.v
    if v[1] * v[2] >= 0.0 and v[5] * v[6] >= 0.0 and profile.brake.duration == 0.0:
        return extent.min, extent.max
    parts = (profile.brake, profile) if profile.brake.duration > 0.0 else (profile,)
    # The profile's states also include the end; the state of a piece without duration is undefined.
    pieces = [Piece(*piece) for part in parts for piece in zip(part.t, part.p, part.v, part.a, part.j, strict=False)]
    return position_range([piece for piece in pieces if piece.seconds > 0.0])


class AxisStop:
    """Time-optimal stop of one axis: the acceleration ramps to its bound, stays there, and ramps to zero.

    The arguments `most` and `jerk` are the bounds of acceleration [u/s^2] and jerk [u/s^3].
    """

    __slots__ = ("_pieces", "highest", "lowest", "seconds")

    lowest: float
    """[u] Smallest position during the stop, ends included."""
    highest: float
    """[u] Largest position during the stop, ends included."""
    seconds: float
    """[s] Time until the axis rests."""

    def __init__(self, position: float, velocity: float, acceleration: float, *, most: float, jerk: float) -> None:
        v, a = velocity, acceleration
        onward = v + a * abs(a) / (2.0 * jerk)  # velocity once the acceleration is zero
        way = -1.0 if onward > 0.0 else 1.0
        v, a = -way * v, -way * a  # the axis is mirrored so that it brakes from a positive velocity
        peak = math.sqrt(max(jerk * v + a * a / 2.0, 0.0))
        held = 0.0
        if peak > most:
            peak = max(most, -a)
            held = max((v + a * a / (2.0 * jerk) - peak * peak / jerk) / peak, 0.0)
        state = position, velocity, acceleration
        self._pieces: list[Piece] = []
        for seconds, ramp in ((max((a + peak) / jerk, 0.0), way * jerk), (held, 0.0), (peak / jerk, -way * jerk)):
            self._pieces.append(Piece(seconds, *state, ramp))
            state = self._pieces[-1].after(seconds)
        self.seconds = sum(piece.seconds for piece in self._pieces)
        self.lowest, self.highest = position_range(self._pieces)

    def at(self, t: float) -> tuple[float, float, float]:
        """Position [u], velocity [u/s] and acceleration [u/s^2], `t` seconds after the stop began."""
        for piece in self._pieces:
            if t < piece.seconds:
                return piece.after(t)
            t -= piece.seconds
        last = self._pieces[-1]
        return last.after(last.seconds)[0], 0.0, 0.0
