"""How fast a hand moves, when it moves, and in how many pieces.

The measures and their use after stroke: Schwarz, Kanzler, Lambercy, Luft, Veerbeek, "Systematic review on kinematic
assessments of upper limb movements after stroke", Stroke 50(3), 2019.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.samples import numbers, positive, rows

__all__ = ["RISE", "mean_speed", "movement_interval", "movement_time", "peak_speed", "velocity_peaks"]

Array = NDArray[np.float64]

RISE = 0.02
"""[m/s] of a peak of the speed."""


def mean_speed(velocity: ArrayLike, time: ArrayLike | None = None) -> float:
    """Mean speed [m/s] over the time of the samples: the trapezoids below |v|, over their duration.

    Flash and Hogan, "The coordination of arm movements", J. Neurosci. 5(7), 1985: a minimum-jerk reach has 8/15 of its
    peak speed.

    Parameters
    ----------
    velocity : (N, d) [m/s], or speeds (N,).
    time : (N,) [s] increasing; even by default.
    """
    speed = np.linalg.norm(rows("velocity", velocity), axis=1)
    t = np.arange(len(speed)) if time is None else numbers("time", time)
    if t.shape != speed.shape or not (np.diff(t) > 0).all():
        raise ConfigurationError("time", f"shape {t.shape}", f"({len(speed)},), increasing")
    if len(t) == 1:
        return float(speed[0])
    return float(np.average((speed[1:] + speed[:-1]) / 2, weights=np.diff(t)))


def peak_speed(velocity: ArrayLike) -> float:
    """Largest speed [m/s]: max |v_i|. Of a minimum-jerk reach of length A in time D it is 1.875 A/D.

    Flash and Hogan 1985, as `mean_speed`.

    Parameters
    ----------
    velocity : (N, d) [m/s], or speeds (N,).
    """
    return float(np.linalg.norm(rows("velocity", velocity), axis=1).max())


def movement_interval(speed: ArrayLike, rate_hz: float, *, threshold: float = 0.05) -> tuple[float, float]:
    """Start and end [s] of the movement, from the first sample: where the speed first rises above, and last falls below
    `threshold` times its peak, interpolated between samples.

    A fraction of the peak, as in Murphy, Willén, Sunnerhagen, "Kinematic variables quantifying upper-extremity
    performance after stroke during reaching and drinking from a glass", Neurorehabil. Neural Repair 25(1), 2011 (who
    take 2 %; 5 % stands more noise). A movement that begins or ends faster than that takes the array's own end.

    Parameters
    ----------
    speed : (N,) [m/s] at `rate_hz` [Hz].
    """
    v, rate = numbers("speed", speed), positive("rate_hz", rate_hz)
    if v.ndim != 1:
        raise ConfigurationError("speed", f"shape {v.shape}", "(N,)")
    if not 0 < threshold < 1:
        raise ConfigurationError("threshold", threshold, "a fraction of the peak speed between 0 and 1")
    least = threshold * v.max()
    if not least > 0:
        raise ConfigurationError("speed", "0 m/s throughout", "a hand that moves")
    above = np.flatnonzero(v >= least)
    first, last = int(above[0]), int(above[-1])
    begin = first - (v[first] - least) / (v[first] - v[first - 1]) if first else 0.0
    end = last + (v[last] - least) / (v[last] - v[last + 1]) if last + 1 < len(v) else float(last)
    return float(begin) / rate, float(end) / rate


def movement_time(speed: ArrayLike, rate_hz: float, *, threshold: float = 0.05) -> float:
    """Time [s] from start to end of the movement, as `movement_interval` finds them.

    Of a minimum-jerk reach in time D it is D sqrt(1 - sqrt(threshold)): 0.881 D at 5 %. Noise that reaches the
    threshold at rest counts as movement (not in `score`).
    """
    begin, end = movement_interval(speed, rate_hz, threshold=threshold)
    return end - begin


def velocity_peaks(speed: ArrayLike, rate_hz: float, *, rise: float = RISE, apart: float = 0.15) -> int:
    """Number of peaks of the speed, each `rise` above the dips beside it and `apart` from higher ones; 1 is ideal.

    Where the array begins or ends in motion, the speed is taken to be zero outside of it.

    Murphy, Willén, Sunnerhagen 2011 (movement units: 20 mm/s, 150 ms); peaks as a measure of recovery: Rohrer et al.,
    "Movement smoothness changes during stroke recovery", J. Neurosci. 22(18), 2002.

    Parameters
    ----------
    speed : (N,) [m/s] at `rate_hz` [Hz].
    rise : [m/s]
    apart : [s]
    """
    from scipy.signal import find_peaks  # noqa: PLC0415

    v, rate = numbers("speed", speed), positive("rate_hz", rate_hz)
    if v.ndim != 1:
        raise ConfigurationError("speed", f"shape {v.shape}", "(N,)")
    distance = max(1.0, positive("apart", apart) * rate)
    peaks, _ = find_peaks(np.concatenate(([0.0], v, [0.0])), prominence=positive("rise", rise), distance=distance)
    return len(peaks)
