"""Speed, timing, number of submovements, and smoothness of a hand.

The measures and their use after stroke: Schwarz, Kanzler, Lambercy, Luft, Veerbeek, "Systematic review on kinematic
assessments of upper limb movements after stroke", Stroke 50(3), 2019.

SPARC: Balasubramanian, Melendez-Calderon, Burdet, "A robust and sensitive metric for quantifying movement smoothness",
IEEE Trans. Biomed. Eng. 59(8), 2012, with the adaptive cut-off of Balasubramanian, Melendez-Calderon, Roby-Brami,
Burdet, "On the analysis of movement smoothness", J. NeuroEng. Rehabil. 12:112, 2015. Jerk: Hogan and Sternad,
"Sensitivity of smoothness measures to movement duration, amplitude, and arrests", J. Mot. Behav. 41(6), 2009.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import positive
from rehab_opt.measures.samples import CUT_OFF_HZ, numbers, rows

__all__ = [
    "RISE", "THRESHOLD", "dimensionless_jerk", "log_dimensionless_jerk", "mean_speed", "movement_interval",
    "movement_time", "peak_speed", "spectral_arc_length", "velocity_peaks",
]  # fmt: skip

Array = NDArray[np.float64]

RISE = 0.02
"""[m/s] Least height of a speed peak above the dips beside it."""
PADDING = 4
"""Zero padding up to 2^PADDING times the next power of two, for a finely sampled spectrum."""
THRESHOLD = 0.05
"""The spectrum ends at the last frequency whose amplitude reaches this fraction of the largest."""
FEWEST_JERK = 7
"""Least number of samples of a jerk; a second difference at the ends needs four."""


def mean_speed(velocity: ArrayLike, time: ArrayLike | None = None) -> float:
    """Mean speed [m/s] over the duration of the samples, by the trapezoidal rule.

    Flash and Hogan, "The coordination of arm movements", J. Neurosci. 5(7), 1985: for a minimum-jerk reach it is 8/15
    of the peak speed.

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
    """Largest speed [m/s]: max |v_i|. For a minimum-jerk reach of length A in time D it is 1.875 A/D.

    Source: Flash and Hogan 1985, see `mean_speed`.

    Parameters
    ----------
    velocity : (N, d) [m/s], or speeds (N,).
    """
    return float(np.linalg.norm(rows("velocity", velocity), axis=1).max())


def movement_interval(speed: ArrayLike, rate_hz: float, *, threshold: float = 0.05) -> tuple[float, float]:
    """Start and end [s] of a movement: the speed first rises above `threshold`, and last falls below it.

    `threshold` is a fraction of the peak speed. The times count from the first sample and are interpolated between
    samples. Murphy, Willén, Sunnerhagen, "Kinematic variables quantifying upper-extremity performance after stroke
    during reaching and drinking from a glass", Neurorehabil. Neural Repair 25(1), 2011, use 2 %; 5 % tolerates more
    noise. If the array begins or ends above the threshold, the movement starts or ends there.

    Parameters
    ----------
    speed : (N,) [m/s] at `rate_hz` [Hz].
    """
    v, rate = _speeds(speed), positive("rate_hz", rate_hz)
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

    For a minimum-jerk reach of duration D the movement time is D sqrt(1 - sqrt(threshold)): 0.881 D at 5 %. Noise at
    rest above the threshold counts as movement; only `score` prevents this.
    """
    begin, end = movement_interval(speed, rate_hz, threshold=threshold)
    return end - begin


def velocity_peaks(speed: ArrayLike, rate_hz: float, *, rise: float = RISE, apart: float = 0.15) -> int:
    """Number of speed peaks; one is ideal.

    A peak is at least `rise` above the dips beside it; any higher peak is at least `apart` [s] away.

    The speed counts as zero outside the array. Source: the movement units of Murphy, Willén, Sunnerhagen 2011 (20 mm/s,
    150 ms). Rohrer et al., "Movement smoothness changes during stroke recovery", J. Neurosci. 22(18), 2002, use peaks
    as a measure of recovery.

    Parameters
    ----------
    speed : (N,) [m/s] at `rate_hz` [Hz].
    rise : [m/s] least height above the dips.
    apart : [s] least time from a higher peak.
    """
    from scipy.signal import find_peaks  # noqa: PLC0415

    v, rate = _speeds(speed), positive("rate_hz", rate_hz)
    distance = max(1.0, positive("apart", apart) * rate)
    peaks, _ = find_peaks(np.concatenate(([0.0], v, [0.0])), prominence=positive("rise", rise), distance=distance)
    return len(peaks)


def spectral_arc_length(speed: ArrayLike, rate_hz: float) -> float:
    """SPARC: minus the arc length of the normalised amplitude spectrum of `speed` (N,), sampled at `rate_hz` [Hz].

    Let V(f) be the amplitude divided by its value at f = 0, and f_c the last frequency below 10 Hz with V >= 0.05:

        - integral over [0, f_c] of sqrt((1 / f_c)^2 + (dV/df)^2) df

    SPARC has no unit and does not depend on the unit of the speed. If f_c is below 10 Hz, SPARC does not depend on the
    duration either. A single minimum-jerk reach has about -1.4; submovements and tremor make SPARC more negative. NaN
    without motion.
    """
    samples, rate = _speeds(speed), positive("rate_hz", rate_hz)
    count = 2 ** (math.ceil(math.log2(len(samples))) + PADDING)
    frequency = np.fft.rfftfreq(count, 1.0 / rate)
    amplitude = np.abs(np.fft.rfft(samples, count))[frequency <= CUT_OFF_HZ]
    if not amplitude.max() > 0:
        return math.nan
    amplitude /= amplitude.max()
    last = int(np.flatnonzero(amplitude >= THRESHOLD)[-1])
    if last == 0:
        return math.nan
    steps = np.diff(amplitude[: last + 1])
    return -float(np.hypot(1.0 / last, steps).sum())


def dimensionless_jerk(velocity: ArrayLike, rate_hz: float) -> float:
    """Integral of the squared jerk, made dimensionless by duration and peak speed; not negative, smaller is smoother.

        D^3 / v_peak^2  integral over [0, D] of |d^2 v / dt^2|^2 dt,      D = (N - 1) / rate_hz

    The result has no unit; for a minimum-jerk reach of any length and duration it is 720 / 1.875^2 = 204.8. Remove rest
    before and after the movement first, because the duration enters with its third power. Velocities (N, d) include the
    turning of the path. Balasubramanian et al. 2015 define the measure by the speed, with a minus sign: for theirs,
    pass speeds (N,) and negate the result.

    Parameters
    ----------
    velocity : (N, d) [m/s] at `rate_hz` [Hz], N >= 7, or speeds (N,).

    Noise enters with the sixth power of its frequency: compare only recordings of the same device, rate and filter.
    """
    v, rate = rows("velocity", velocity, fewest=FEWEST_JERK), positive("rate_hz", rate_hz)
    peak = float(np.linalg.norm(v, axis=1).max())
    if not peak > 0:
        raise ConfigurationError("velocity", "0 m/s throughout", "a hand that moves")
    inner = (v[2:] - 2.0 * v[1:-1] + v[:-2]) * rate**2
    # One-sided second differences at both ends, because a reach is least smooth where it starts and stops.
    first = (2.0 * v[0] - 5.0 * v[1] + 4.0 * v[2] - v[3]) * rate**2
    last = (2.0 * v[-1] - 5.0 * v[-2] + 4.0 * v[-3] - v[-4]) * rate**2
    squared = (np.vstack((first, inner, last)) ** 2).sum(axis=1)
    duration = (len(v) - 1) / rate
    return float(duration**3 / peak**2 * np.trapezoid(squared, dx=1.0 / rate))


def log_dimensionless_jerk(velocity: ArrayLike, rate_hz: float) -> float:
    """LDLJ: minus the natural logarithm of `dimensionless_jerk`; larger is smoother. A minimum-jerk reach has -5.32.

    Balasubramanian et al. 2015. Parameters as in `dimensionless_jerk`. Infinite for a motion without jerk.
    """
    jerk = dimensionless_jerk(velocity, rate_hz)
    return -math.log(jerk) if jerk > 0 else math.inf


def _speeds(speed: ArrayLike) -> Array:
    v = numbers("speed", speed)
    if v.ndim != 1:
        raise ConfigurationError("speed", f"shape {v.shape}", "(N,)")
    return v
