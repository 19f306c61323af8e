"""Retiming of a whole path for a drive: the same path, as fast as its axes may move, no faster than recorded."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.axis_motion import axis_bounds
from rehab_opt.control.path_timing import PathCells, fastest_timing
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.control.watchdog import SHORTEST_TICK
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["SmoothPath", "smooth_path"]

Array = NDArray[np.float64]

CELL = 2.0
"""Ticks: on stretches that take up to so long the square of the pace changes evenly along the path."""
MAX_TICKS = 10_000_000
"""Of a path: close to three hours at 1 kHz."""


class SmoothPath(NamedTuple):
    """A path made followable: positions within the bounds at every tick."""

    times: Array
    """(M,) [s] ticks from the first time of the path, until its last point is reached."""
    positions: Array
    """(M, n) [u]."""
    phase: Array
    """(M,) [s] of the path's own time at which these are passed: it never runs back, nor faster than the ticks do."""
    deviation: Array
    """(n,) [u] largest distance from the path at that time."""

    @property
    def delay(self) -> float:
        """[s] by which the last point is reached later than the path has it."""
        return float(self.times[-1] - self.phase[-1])


def smooth_path(
    times: ArrayLike,
    points: ArrayLike,
    *,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    dt: float = 0.001,
    tolerance: float = 1e-4,
) -> SmoothPath:
    """A recorded or planned path, from rest to rest, for a drive: late where its axes are too slow, not elsewhere.

    All axes wait for one another, so that what couples them (a hand's place, a handle's tilt) stays. A `Smoother`
    leads each axis by itself, which breaks that; it is for targets whose future is unknown, this for a path after its
    run.

    Between its points the path is interpolated by shape-preserving cubics, which leave no range the points keep. One
    parameter of time is led along it as fast as the bounds of speed and acceleration allow, at most at the recorded
    pace (`fastest_timing`). The positions are then averaged over a window T: means of what keeps a bound keep it too,
    the jerk is at most 2 a / T, and an axis leaves the path by at most a T^2 / 24. T and the acceleration a are chosen
    so that these are within `jerk` and `tolerance`.

    Parameters
    ----------
    times : (N,) [s], increasing.
    points : (N, n) [u], in the order of the axes; those outside the position bounds are moved onto them.
    velocity, acceleration, jerk : (n,) bounds of the axes [u/s, u/s^2, u/s^3 with u = rad or m], positive and finite; a
        scalar stands for all.
    lower, upper : (n,) position bounds [u]; None or infinite for none.
    dt : tick [s].
    tolerance : [u] by which an axis may leave the path.

    Raises
    ------
    ConfigurationError : times not increasing, points of the wrong shape, a bound or number that cannot be used.
    """
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  (loaded when used)

    t, x = checked_array("times", times, "numbers"), checked_array("points", points, "numbers")
    if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0) or not np.all(np.isfinite(t)):
        raise ConfigurationError("times", times, "at least two finite, increasing times (N,)")
    if x.ndim != 2 or len(x) != len(t) or not np.all(np.isfinite(x)):
        raise ConfigurationError("points", points, f"finite numbers of shape ({t.size}, n)")
    dt = checked_number("dt", dt, above=SHORTEST_TICK, below=1e6)
    tolerance = checked_number("tolerance", tolerance, above=0.0)
    bounds = axis_bounds(
        lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, jerk=jerk, axes=x.shape[1]
    )
    path = PchipInterpolator(t, np.clip(x, bounds.lower, bounds.upper), axis=0)
    window, gentle = _window(np.array(bounds.acceleration), np.array(bounds.jerk), dt, tolerance)

    needed = np.maximum(np.diff(t), (np.abs(np.diff(x, axis=0)) / bounds.velocity).max(axis=1))
    _check_length(window * dt + float(needed.sum()), dt, ("dt", dt), ("velocity", velocity), ("jerk", jerk))
    parts = np.ceil(needed / (CELL * dt)).astype(int)
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)  # which part of its piece each is
    knots = np.append(within * np.repeat(np.diff(t) / parts, parts) + np.repeat(t[:-1], parts), t[-1])
    cells = PathCells(knots, *(path.derivative(order)(knots[:-1]) for order in (1, 2, 3)))
    timing = fastest_timing(cells, velocity=np.array(bounds.velocity), acceleration=gentle)

    _check_length(timing.times[-1], dt, ("tolerance", tolerance), ("acceleration", acceleration), ("jerk", jerk))
    still = np.full(window // 2, 0.0)
    ticks = np.concatenate([still, dt * np.arange(math.ceil(timing.times[-1] / dt) + 1)])
    phase = timing.at(np.append(ticks, still + timing.times[-1]))
    followed = np.clip(path(phase), bounds.lower, bounds.upper)  # rounding leaves no range either
    padded = np.concatenate([np.repeat(followed[:1], window // 2, axis=0), followed,
                             np.repeat(followed[-1:], window // 2, axis=0)])  # fmt: skip
    even = np.full(window, 1.0 / window)
    positions = np.column_stack([np.convolve(column, even, mode="valid") for column in padded.T])
    positions = np.clip(positions, followed.min(axis=0), followed.max(axis=0))
    positions[0], positions[-1] = followed[0], followed[-1]
    when = t[0] + dt * np.arange(len(positions))
    return SmoothPath(when, positions, phase, np.abs(positions - followed).max(axis=0))


def _check_length(seconds: float, dt: float, *given: tuple[str, object]) -> None:
    """Refuse a path that takes more ticks than a memory holds; `given` is what makes it so long."""
    if not seconds <= MAX_TICKS * dt:  # NaN, too
        names, values = zip(*given, strict=True)
        expected = f"a path of at most {MAX_TICKS} ticks; this one takes {seconds:.3g} s"
        raise ConfigurationError(", ".join(names), values, expected)


def _window(acceleration: Array, jerk: Array, dt: float, tolerance: float) -> tuple[int, Array]:
    """Ticks to average over, an odd number, and the accelerations (n,) for which that keeps `jerk` and `tolerance`."""
    longest = float(np.max(np.minimum(2.0 * acceleration / jerk, np.cbrt(48.0 * tolerance / jerk))))
    window = 2 * math.ceil(min(max(longest / dt - 1.0, 0.0), float(2 * MAX_TICKS)) / 2.0) + 1  # more is refused
    span = np.float64(window * dt)
    return window, np.minimum.reduce([acceleration, jerk * span / 2.0, np.full_like(jerk, 24.0 * tolerance / span**2)])
