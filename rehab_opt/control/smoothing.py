"""Retiming of a whole path for a drive: the same path, as fast as the axes allow, but no faster than recorded."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.axis_motion import axis_bounds
from rehab_opt.control.path_timing import PathCells, ruckig_timing
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.control.watchdog import SHORTEST_TICK
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.measured_path import measured_path
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["SmoothPath", "smooth_path"]

Array = NDArray[np.float64]

LONGEST, GRADE, EVEN, NEAR = 12.0, 0.2, 9, 0.95
"""Control points are spaced in time: largest jerk * spacing^3 / tolerance; largest growth of the spacing, in s per s;
number of spacings that are averaged; used fraction of the tolerance.
"""
MAX_TICKS = 10_000_000  # of a path: close to three hours at 1 kHz


class SmoothPath(NamedTuple):
    """A retimed path with positions within the bounds at every tick."""

    times: Array
    """(M,) [s] ticks from the path's first time until its last point is reached."""
    positions: Array
    """(M, n) [u]."""
    phase: Array
    """(M,) [s] time on the path at each tick; it never decreases, nor runs faster than the ticks."""
    deviation: Array
    """(n,) [u] largest distance from the path at `phase`."""

    @property
    def delay(self) -> float:
        """Delay [s] of the last point relative to the path."""
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
    measured: bool = True,
) -> SmoothPath:
    """Retime a recorded or planned path, from rest to rest, for a drive; only axes that are too slow delay it.

    All axes wait for one another, so coupled quantities (hand position, handle tilt) are preserved. Times that do not
    increase, a wrong shape, and an invalid bound or number raise `ConfigurationError`. Lost markers (zeros) and spikes
    are followed: drop their rows first, or read the file with `recordings.reading.read_recording`, which does.

    Parameters
    ----------
    times : (N,) [s], increasing. dt : tick [s].
    points : (N, n) [u]; points outside the position bounds are clipped.
    velocity, acceleration, jerk : (n,) bounds of the axes [u/s, u/s^2, u/s^3 with u = rad or m], positive and finite; a
        scalar applies to all axes.
    lower, upper : (n,) position bounds [u]; None or infinite for none.
    tolerance : [u] largest deviation of an axis from the path.
    measured : whether the points are samples of a tracker. A planned path (False) is passed as it is; so is one of at
        most 40 points that are neither held nor rounded, with no two times nearly equal.
    """
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  (loaded when used)

    t, x = checked_array("times", times, "numbers"), checked_array("points", points, "numbers")
    if t.ndim != 1 or t.size < 2 or not (np.all(np.diff(t) > 0.0) and np.all(np.isfinite(t))):
        raise ConfigurationError("times", times, "at least two finite, increasing times (N,)")
    if x.ndim != 2 or len(x) != len(t) or not np.all(np.isfinite(x)):
        raise ConfigurationError("points", points, f"finite numbers of shape ({t.size}, n)")
    begun, t = t[0], t - t[0]  # seconds since 1970 leave no digits for a third difference
    t, x, _ = measured_path(t, x) if measured else (t, x, ())
    dt = checked_number("dt", dt, above=SHORTEST_TICK, below=1e6)
    tolerance, n = checked_number("tolerance", tolerance, above=0.0), x.shape[1]
    bounds = axis_bounds(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, jerk=jerk, axes=n)
    path = PchipInterpolator(t, np.clip(x, bounds.lower, bounds.upper), axis=0)
    limits = np.array(bounds[2:])
    least = ((np.ptp(x, axis=0) / limits) ** (1.0 / np.arange(1, 4)[:, None])).max()
    given = ("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk), ("tolerance", tolerance)
    _check_length(max(t[-1] - t[0], least), dt, ("dt", dt), *given)
    spline = _rounded(path, *limits, dt=dt, tolerance=tolerance)
    begins = np.arange(len(spline.c) - 3.0)
    cells = PathCells(np.append(begins, len(begins)), *(spline(begins, order) for order in (1, 2, 3)))
    most = np.column_stack([limits, (1.0, math.inf, math.inf)])  # the recording's time passes no faster than recorded
    timing = ruckig_timing(cells, velocity=most[0], acceleration=most[1], jerk=most[2])
    _check_length(timing.times[-1], dt, *given)
    moved = spline(timing.at(dt * np.arange(math.ceil(timing.times[-1] / dt) + 1)))
    moved[[0, -1]] = np.column_stack([path(t[[0, -1]]), t[[0, -1]]])
    positions, phase = np.clip(moved[:, :-1], bounds.lower, bounds.upper), np.clip(moved[:, -1], t[0], t[-1])
    when, off = dt * np.arange(len(positions)), np.abs(positions - path(phase)).max(axis=0)
    return SmoothPath(begun + when, positions, begun + phase, off)


def _rounded(path: Any, velocity: Array, acceleration: Array, jerk: Array, *, dt: float, tolerance: float) -> Any:
    """Uniform cubic B-spline of the path's axes and time, within `tolerance` of the path and within its range."""
    from scipy.interpolate import BSpline  # noqa: PLC0415  (loaded when used)
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415

    t, length = path.x, np.diff(path.x)
    longest = max(dt, float(np.minimum(2.0 * acceleration / jerk, np.cbrt(LONGEST * tolerance / jerk)).max()))
    speed = (np.abs(np.diff(path(t), axis=0)) / (velocity * length[:, None])).max(axis=1)
    parts = np.ceil(length / longest).astype(int)
    edges = np.interp(np.arange(parts.sum() + 1), np.append(0, np.cumsum(parts)), t)
    apart = np.repeat(longest / np.maximum(speed, 1.0), parts)  # control points between two edges
    while True:
        size = np.minimum(np.append(apart, math.inf), np.append(math.inf, apart))
        size = np.minimum.accumulate(size - GRADE * edges) + GRADE * edges
        size = np.minimum.accumulate((size + GRADE * edges)[::-1])[::-1] - GRADE * edges
        count = np.append(0.0, np.cumsum(np.diff(edges) / np.maximum(np.minimum(size[1:], size[:-1]), 1e-300)))
        _check_length(4.0 * dt * count[-1], dt, ("tolerance", tolerance), ("jerk", jerk))
        steps = np.diff(np.interp(np.linspace(0.0, count[-1], math.ceil(count[-1]) + 1), count, edges))
        steps = uniform_filter1d(uniform_filter1d(steps, EVEN, mode="reflect"), EVEN, mode="reflect")
        places = np.append(t[0], t[-1] - (t[-1] - t[0]) * np.append(np.cumsum(steps[:0:-1])[::-1], 0.0) / steps.sum())
        points = np.column_stack([path(places), places])
        points = np.vstack([2.0 * points[0] - points[1], points, 2.0 * points[-1] - points[-2]])
        spline = BSpline(np.arange(-3.0, len(points) + 1.0), points, 3)
        at = np.arange(0.0, len(points) - 2.75, 0.25)
        moved = spline(np.append(at, np.interp(t, spline(at)[:, -1], at)))  # also at the path's knots
        phase = np.clip(moved[:, -1], t[0], t[-1])
        off = np.abs(moved[:, :-1] - path(phase)).max(axis=1) / (NEAR * tolerance)
        if off.max() <= 1.0:
            return spline
        off = np.where(off > 1.0, 1.05 * np.sqrt(off), 1.0)
        np.minimum.at(apart, k := np.searchsorted(edges[1:-1], phase, side="right"), apart[k] / off)


def _check_length(seconds: float, dt: float, *given: tuple[str, object]) -> None:
    """Raise an error for a path with too many ticks for the memory; `given` names the cause."""
    if not seconds <= MAX_TICKS * dt:  # NaN, too
        names, values = zip(*given, strict=True)
        expected = f"a path of at most {MAX_TICKS} ticks; this one takes {seconds:.3g} s"
        raise ConfigurationError(", ".join(names), values, expected)
