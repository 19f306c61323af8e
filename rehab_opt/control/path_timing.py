"""Timing of a path by Ruckig, with the progress s along q(s) as its only axis.

    q' = q_s s',    q'' = q_s s'' + q_ss s'^2,    q''' = q_s s''' + 3 q_ss s' s'' + q_sss s'^3

The path is cut into zones. In a zone, the progress has bounds V, A and J of speed, acceleration and jerk. With the
bounds v, a and j of an axis and the fractions c_a, c_j and c_x, they are the minimum over all axes of

    V = min(v / |q_s|, (c_a a / |q_ss|)^(1/2), (c_j j / |q_sss|)^(1/3))
    A = min((a - |q_ss| V^2) / |q_s|, c_x (j - |q_sss| V^3) / (3 |q_ss| V))
    J = (j - |q_sss| V^3 - 3 |q_ss| V A) / |q_s|

Ruckig plans to the end of each zone, at a speed that allows all later zones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PathCells", "PathTiming", "ruckig_timing"]

Array = NDArray[np.float64]

CURVE, BEND, CROSS = 0.7, 0.7, 0.5  # c_a, c_j, c_x
ALIKE, SHARPER, STRONG = 1.05, 1.02, 3.0  # ratio in a zone: of speeds; the same without jerk bounds; of accelerations
QUICK = 1e-4  # [s] Least time in which the progress reaches its speed limit, also where no axis moves.
PART, SPEED, RAMP = 1.0 - 1e-4, 1.0 - 5e-7, 1e-3
"""Used fraction of a zone's length; used fraction of the speed limit at its ends; least rise time of the acceleration,
as a fraction of the zone's shortest time. Without these margins, Ruckig refuses some zones because of rounding.
"""


class PathCells(NamedTuple):
    """A path of n axes in K cubic cells: their ends (K + 1,), and three derivatives (K, n) at the start of each."""

    knots: Array
    first: Array
    second: Array
    third: Array


class PathTiming(NamedTuple):
    """Timed progress in M pieces of constant jerk.

    `times` (M + 1,) [s] are the ends of the pieces. `pieces` (4, M) are the progress and its first three derivatives at
    the start of each piece, and `end` is the final progress.
    """

    times: Array
    pieces: Array
    end: float

    def at(self, times: Array) -> Array:
        """Progress (N,) at `times` (N,) [s]; after the last piece, the path's end."""
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        since, (s, v, a, j) = times - self.times[k], self.pieces[:, k]
        return np.where(times < self.times[-1], s + since * (v + since * (a / 2.0 + since * j / 6.0)), self.end)


def ruckig_timing(
    cells: PathCells, *, velocity: Array, acceleration: Array, jerk: Array | float = math.inf, fastest: float = math.inf
) -> PathTiming:
    """Time the path from rest to rest within the bounds (n,) of its axes; infinite bounds are ignored.

    `fastest` bounds the speed of the progress. q(s) must be C2, or only C1 without jerk bounds.
    """
    length = np.diff(cells.knots)[:, None]
    mid, second = cells.first + cells.second * length / 2, cells.second + cells.third * length
    steep = np.abs([cells.first, mid, mid + second * length / 2]).max(axis=0)  # Bernstein coefficients
    bent, twisted = np.abs([cells.second, second]).max(axis=0), np.abs(cells.third)
    with np.errstate(divide="ignore"):  # an axis at rest bounds nothing
        curves = np.sqrt(CURVE * acceleration / bent), np.cbrt(BEND * jerk / twisted)
        speed = np.minimum(np.minimum.reduce([velocity / steep, *curves]).min(axis=1), fastest)
        strong = np.minimum((acceleration / steep).min(axis=1), speed / QUICK)
        alike = np.log([[ALIKE if np.isfinite(jerk).any() else SHARPER], [STRONG]])
        steps = np.floor(np.log([speed / speed.max() * (1.0 + 1e-9), strong]) / alike)
        begins = np.append(0, 1 + np.flatnonzero(np.diff(steps).any(axis=0)))
        top = np.minimum.reduceat(speed, begins)
        steep, bent, twisted = (np.maximum.reduceat(each, begins) for each in (steep, bent, twisted))
        left = jerk - twisted * top[:, None] ** 3
        either = (acceleration - bent * top[:, None] ** 2) / steep, CROSS * left / (3.0 * bent * top[:, None])
        quick = np.minimum(np.minimum(*either).min(axis=1), top / QUICK)
        sudden = ((left - 3.0 * bent * (top * quick)[:, None]) / steep).min(axis=1)
    return _passage(np.append(cells.knots[begins], cells.knots[-1]), top, quick, sudden)


def _passage(places: Array, top: Array, quick: Array, sudden: Array) -> PathTiming:
    """Timing by Ruckig through Z zones, which lie between the progress values `places` (Z + 1,).

    top, quick, sudden : (Z,) bounds of speed, acceleration and jerk of the progress.
    """
    import ruckig  # noqa: PLC0415  (loaded when used)

    solver, question, plan = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    question.current_position = question.current_acceleration = question.target_acceleration = [0.0]
    question.target_position = [1.0]
    ways, times, pieces = np.diff(places), [np.zeros(1)], []
    # Scale to a zone length of 1 and bounds of at least 1, since Ruckig's tolerances are absolute.
    units = np.maximum.reduce([ways / top, np.sqrt(ways / quick), np.cbrt(ways / sudden)])
    if np.isfinite(sudden).any():
        sudden = np.minimum(sudden, quick / (RAMP * units))
    speeds = SPEED * np.concatenate([[0.0], np.minimum(top[:-1], top[1:]), [0.0]])
    for z in (*range(len(ways) - 1, -1, -1), *range(len(ways))):  # backward and forward pass over the zones
        slow, fast = (z, z + 1) if speeds[z] < speeds[z + 1] else (z + 1, z)
        speeds[fast] = min(speeds[fast], _reached(*map(float, (speeds[slow], PART * ways[z], quick[z], sudden[z]))))
    for z, (way, unit) in enumerate(zip(ways, units, strict=True)):
        question.current_velocity, question.target_velocity = [[each * unit / way] for each in speeds[z : z + 2]]
        question.max_velocity, question.max_acceleration = [top[z] * unit / way], [quick[z] * unit**2 / way]
        question.max_jerk = [sudden[z] * unit**3 / way]
        solver.calculate(question, plan)
        profile = plan.profiles[0][0]
        times.append(times[-1][-1] + unit * np.cumsum(profile.t))
        state = np.array([profile.p[:7], profile.v[:7], profile.a[:7], profile.j])
        pieces.append(way * state / unit ** np.arange(4.0)[:, None] + np.array([[places[z]], [0.0], [0.0], [0.0]]))
    return PathTiming(np.concatenate(times), np.hstack(pieces), float(places[-1]))


def _reached(speed: float, way: float, acceleration: float, jerk: float) -> float:
    """Largest speed that can be reached from `speed` over the distance `way`, with zero acceleration at both ends."""
    brief = acceleration / jerk
    if way >= (2.0 * speed + acceleration * brief) * brief:
        half = speed + acceleration * brief / 2.0
        return math.sqrt(half * half + 2.0 * acceleration * (way - brief * speed)) - half + speed
    p, q = 2.0 * speed / 3.0, way * math.sqrt(jerk) / 2.0  # y^3 + 3 p y = 2 q, with y^2 the rise
    if p**1.5 < 1e-12 * q:
        return float(speed + (2.0 * q) ** (2.0 / 3.0))
    return float(speed + 4.0 * p * math.sinh(math.asinh(q / p**1.5) / 3.0) ** 2)
