"""Smoothness of a movement as the length of its speed's spectrum.

SPARC: Balasubramanian, Melendez-Calderon, Burdet, "A robust and sensitive metric for quantifying movement smoothness",
IEEE Trans. Biomed. Eng. 59(8), 2012, with the adaptive cut-off of Balasubramanian, Melendez-Calderon, Roby-Brami,
Burdet, "On the analysis of movement smoothness", J. NeuroEng. Rehabil. 12:112, 2015.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.errors import ConfigurationError

__all__ = ["spectral_arc_length"]

PADDING = 4
"""Zeros are added up to 2^PADDING times the next power of two, so that the spectrum is finely sampled."""
CUT_OFF = 10.0
"""[Hz] Frequencies above are no voluntary movement."""
THRESHOLD = 0.05
"""Share of the largest amplitude; the spectrum is followed up to the last frequency that reaches it."""


def spectral_arc_length(speed: ArrayLike, rate_hz: float) -> float:
    """Minus the arc length of the normalised amplitude spectrum of `speed` (N,), sampled at `rate_hz` [Hz].

    With V(f) the amplitude over its value at zero and f_c the last frequency below 10 Hz at which V >= 0.05,

        - integral over [0, f_c] of sqrt((1 / f_c)^2 + (dV/df)^2) df

    It does not depend on the unit of the speed, nor (as long as f_c is below 10 Hz) on the duration. A single
    minimum-jerk reach has about -1.4; the more submovements and tremor, the more negative. NaN where nothing moves.

    Raises
    ------
    ConfigurationError : a speed that is not a finite array (N,), or a rate that is not above zero.
    """
    samples = np.asarray(speed, dtype=np.float64)
    if samples.ndim != 1 or not len(samples) or not np.isfinite(samples).all():
        raise ConfigurationError("speed", samples.shape, "finite numbers (N,)")
    if not 0 < rate_hz < math.inf:
        raise ConfigurationError("rate_hz", rate_hz, "a number above zero")
    count = 2 ** (math.ceil(math.log2(len(samples))) + PADDING)
    frequency = np.fft.rfftfreq(count, 1.0 / rate_hz)
    amplitude = np.abs(np.fft.rfft(samples, count))[frequency <= CUT_OFF]
    if not amplitude.max() > 0:
        return math.nan
    amplitude /= amplitude.max()
    last = int(np.flatnonzero(amplitude >= THRESHOLD)[-1])
    if last == 0:
        return math.nan
    steps = np.diff(amplitude[: last + 1])
    return -float(np.hypot(1.0 / last, steps).sum())
