"""Smoothness of a movement: of its speed's spectrum, and of its jerk.

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
from rehab_opt.measures.samples import numbers, positive, rows

__all__ = ["THRESHOLD", "dimensionless_jerk", "log_dimensionless_jerk", "spectral_arc_length"]

Array = NDArray[np.float64]

PADDING = 4
"""Zeros are added up to 2^PADDING times the next power of two, so that the spectrum is finely sampled."""
CUT_OFF = 10.0
"""[Hz] Frequencies above are no voluntary movement."""
THRESHOLD = 0.05
"""Fraction of the largest amplitude; the spectrum is followed up to the last frequency that reaches it."""
FEWEST_JERK = 7
"""Samples; a second difference at its ends needs four."""


def spectral_arc_length(speed: ArrayLike, rate_hz: float) -> float:
    """SPARC: minus the arc length of the normalised amplitude spectrum of `speed` (N,), sampled at `rate_hz` [Hz].

    With V(f) the amplitude over its value at zero and f_c the last frequency below 10 Hz at which V >= 0.05,

        - integral over [0, f_c] of sqrt((1 / f_c)^2 + (dV/df)^2) df

    It has no unit. It does not depend on the unit of the speed, nor (as long as f_c is below 10 Hz) on the duration. A
    single minimum-jerk reach has about -1.4; the more submovements and tremor, the more negative. NaN where nothing
    moves.
    """
    samples, rate = numbers("speed", speed), positive("rate_hz", rate_hz)
    if samples.ndim != 1:
        raise ConfigurationError("speed", f"shape {samples.shape}", "(N,)")
    count = 2 ** (math.ceil(math.log2(len(samples))) + PADDING)
    frequency = np.fft.rfftfreq(count, 1.0 / rate)
    amplitude = np.abs(np.fft.rfft(samples, count))[frequency <= CUT_OFF]
    if not amplitude.max() > 0:
        return math.nan
    amplitude /= amplitude.max()
    last = int(np.flatnonzero(amplitude >= THRESHOLD)[-1])
    if last == 0:
        return math.nan
    steps = np.diff(amplitude[: last + 1])
    return -float(np.hypot(1.0 / last, steps).sum())


def dimensionless_jerk(velocity: ArrayLike, rate_hz: float) -> float:
    """Squared jerk over the movement, made dimensionless by its duration and peak speed: 0 or more, less is smoother.

        D^3 / v_peak^2  integral over [0, D] of |d^2 v / dt^2|^2 dt,      D = (N - 1) / rate_hz

    It has no unit. Of a minimum-jerk reach it is 720 / 1.875^2 = 204.8, of any length and duration. Cut the rest before
    and after the movement off: the duration counts with its third power. Balasubramanian et al. 2015 negate it and use
    the speed, which is this function of speeds (N,); of velocities the turning of the path counts too.

    Parameters
    ----------
    velocity : (N, d) [m/s] at `rate_hz` [Hz], N >= 7, or speeds (N,).

    Noise counts with the sixth power of its frequency. Compare only recordings of one device, rate and filter.
    """
    v, rate = rows("velocity", velocity, fewest=FEWEST_JERK), positive("rate_hz", rate_hz)
    peak = float(np.linalg.norm(v, axis=1).max())
    if not peak > 0:
        raise ConfigurationError("velocity", "0 m/s throughout", "a hand that moves")
    inner = (v[2:] - 2.0 * v[1:-1] + v[:-2]) * rate**2
    # One-sided at the ends, of second order: a reach is least smooth where it begins and stops.
    first = (2.0 * v[0] - 5.0 * v[1] + 4.0 * v[2] - v[3]) * rate**2
    last = (2.0 * v[-1] - 5.0 * v[-2] + 4.0 * v[-3] - v[-4]) * rate**2
    squared = (np.vstack((first, inner, last)) ** 2).sum(axis=1)
    duration = (len(v) - 1) / rate
    return float(duration**3 / peak**2 * np.trapezoid(squared, dx=1.0 / rate))


def log_dimensionless_jerk(velocity: ArrayLike, rate_hz: float) -> float:
    """LDLJ: minus the natural logarithm of `dimensionless_jerk`; larger is smoother, a minimum-jerk reach has -5.32.

    Balasubramanian et al. 2015. Parameters, errors and what noise does are as of
    `dimensionless_jerk`. Of a motion without jerk it is infinite.
    """
    jerk = dimensionless_jerk(velocity, rate_hz)
    return -math.log(jerk) if jerk > 0 else math.inf
