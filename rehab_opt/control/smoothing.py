"""A whole path made followable: positions with bounded velocity, acceleration and jerk, from rest to rest."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.axis_bounds import numbers
from rehab_opt.control.measured_lag import measured_lag
from rehab_opt.control.profiles import CERTIFIED
from rehab_opt.control.smoother import Smoother
from rehab_opt.errors import ConfigurationError

__all__ = ["SmoothPath", "smooth_path"]

Array = NDArray[np.float64]


class SmoothPath(NamedTuple):
    """A path made followable: positions within the bounds at every tick."""

    times: Array
    """(M,) [s] ticks from the first time of the path, until the last point is reached."""
    positions: Array
    """(M, n) [u]."""
    lag: float
    """[s] by which the positions trail the path, see `measured_lag`."""
    deviation: Array
    """(n,) [u] largest distance from where the path was at the same time."""
    residual: float
    """Largest certificate residual of all ticks; infinite if the axes had to brake."""
    compensation: str
    """"velocity", "preview" or "none": what was done about the lag."""


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
    compensate: bool = True,
) -> SmoothPath:
    """A recorded or planned path as `Smoother` follows it, from rest to rest.

    Between its points the path is interpolated by shape-preserving cubics, which leave no range the points keep.

    Parameters
    ----------
    times : (N,) [s], increasing.
    points : (N, n) [u], in the order of the axes.
    velocity, acceleration, jerk, lower, upper, dt : as for `Smoother`.
    compensate : also follow the path with its own velocity, and ahead of time by the lag, and keep what stays closest.
        The first is nearly exact on a path within the bounds and overshoots at its corners, where the second is better.

    Raises
    ------
    ConfigurationError : times not increasing, points of the wrong shape, a number that is not finite.
    """
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  (loaded when used)

    t, x = numbers("times", times), numbers("points", points)
    if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0) or not np.all(np.isfinite(t)):
        raise ConfigurationError("times", times, "at least two finite, increasing times (N,)")
    if x.ndim != 2 or len(x) != len(t) or not np.all(np.isfinite(x)):
        raise ConfigurationError("points", points, f"finite numbers of shape ({t.size}, n)")
    smoother = Smoother(
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        lower=lower,
        upper=upper,
        dt=dt,
        axes=x.shape[1],
    )
    path = PchipInterpolator(t, x, axis=0)
    ticks = t[0] + dt * np.arange(1, math.ceil((t[-1] - t[0]) / dt - 1e-9) + 1)

    def at(when: Array) -> Array:
        return np.asarray(path(np.clip(when, t[0], t[-1])))

    def followed(targets: Array, speeds: Array | None, compensation: str) -> SmoothPath:
        positions, residual = _followed(smoother, x[0], targets, speeds, x[-1])
        when = t[0] + dt * np.arange(len(positions))
        wanted = at(when)
        lag = measured_lag(when, wanted, positions)
        return SmoothPath(when, positions, lag, np.abs(positions - wanted).max(axis=0), residual, compensation)

    tries = [followed(at(ticks), None, "none")]
    if compensate:
        speeds = np.where((ticks < t[-1])[:, None], path.derivative()(ticks), 0.0)
        tries.append(followed(at(ticks), speeds, "velocity"))
        tries.append(followed(at(ticks + tries[0].lag), None, "preview"))
    fastest = np.broadcast_to(np.asarray(velocity, dtype=np.float64), x.shape[1])
    return min(tries, key=lambda run: (run.residual > CERTIFIED, float(np.max(run.deviation / fastest))))


def _followed(
    smoother: Smoother, start: Array, targets: Array, speeds: Array | None, end: Array
) -> tuple[Array, float]:
    """Positions (M, n) from the start at rest along the targets to rest at the end, and their largest residual."""
    smoother.reset(start)
    commands = [
        smoother.step(target, None if speeds is None else speed)
        for target, speed in zip(targets, targets if speeds is None else speeds, strict=True)
    ]
    commands.append(smoother.step(end))
    while not smoother.arrived:
        commands.append(smoother.step(end))
    return np.array([start, *(command.value for command in commands)]), max(command.residual for command in commands)
