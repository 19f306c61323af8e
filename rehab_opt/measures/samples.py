"""Prepare recordings for the measures: check numbers, resample evenly, filter, and estimate noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array, positive

__all__ = [
    "CUT_OFF_HZ",
    "FEWEST",
    "MAX_CUT_OFF",
    "EvenSamples",
    "evenly_sampled",
    "hand_velocity",
    "low_passed",
    "milliseconds",
    "noise_of_derivative",
    "numbers",
    "passed_by_low_pass",
    "rows",
    "vectors",
    "white_noise",
]

Array = NDArray[np.float64]


def numbers(argument: str, values: object) -> Array:
    """`values` as a nonempty array of finite floats; a `ConfigurationError` names the first bad value."""
    array = checked_array(argument, values, "finite numbers")
    if not array.size:
        raise ConfigurationError(argument, f"shape {array.shape}", "finite numbers, at least one")
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0]
        place = ", ".join(str(int(i)) for i in at)
        value = float(array[tuple(at)])
        raise ConfigurationError(f"{argument}[{place}]", value, "a finite number: leave out or fill what was not seen")
    return array


def milliseconds(*seconds: float) -> str:
    """Two times [s] as text, such as `20 to 1510 ms`; equal ones become `20 ms`."""
    return " to ".join(dict.fromkeys(f"{1e3 * each:{'.3g' if each < 1 else '.0f'}}" for each in seconds)) + " ms"


def vectors(argument: str, values: ArrayLike, *, fewest: int = 1) -> Array:
    """`values` as a finite array (N, d) with N >= `fewest` and d >= 1; raises `ConfigurationError` otherwise."""
    array = numbers(argument, values)
    if array.ndim != 2 or len(array) < fewest:
        raise ConfigurationError(argument, f"shape {array.shape}", f"(N, d) with N at least {fewest}")
    return array


def rows(argument: str, values: ArrayLike, *, fewest: int = 1) -> Array:
    """`values` as a finite array (N, d); (N,) becomes (N, 1). Raises `ConfigurationError` for other input."""
    array = numbers(argument, values)
    if array.ndim not in (1, 2) or len(array) < fewest:
        raise ConfigurationError(argument, f"shape {array.shape}", f"(N,) or (N, d) with N at least {fewest}")
    return array.reshape(len(array), -1)


CUT_OFF_HZ = 10.0
"""[Hz] Default cut-off; voluntary arm movement has lower frequencies."""
FEWEST = 10
"""Least number of samples that a measure needs."""
MAX_CUT_OFF = 0.4
"""Largest cut-off as a fraction of the rate, so that the corrected cut-off is below half of the rate."""
SMALLEST_CUT_OFF = 1e-6
"""Smallest cut-off as a fraction of the rate; below it the filter's poles are too near 1 for double precision."""
ONCE_EACH_WAY = (2**0.5 - 1) ** 0.25
"""A second-order Butterworth filter that runs both ways attenuates by 3 dB at this fraction of its cut-off (Winter
2009)."""
FREQUENCIES = 2001


class EvenSamples(NamedTuple):
    """N samples at a fixed rate: times [s], points (N, d) [m], and notes on interpolated gaps."""

    time: Array
    points: Array
    rate_hz: float
    notes: tuple[str, ...]


def evenly_sampled(time: ArrayLike, points: ArrayLike, *, rate_hz: float | None = None) -> EvenSamples:
    """Samples at even times, by linear interpolation if the recording is uneven.

    Parameters
    ----------
    time : (N,) [s] increasing, N >= 10.
    points : (N, d) [m].
    rate_hz : [Hz], by default one over the recording's median step.

    Raises
    ------
    ConfigurationError : a wrong shape, a number that is not finite, a time not after the one before it, fewer than ten
        samples.
    """
    t, p = numbers("time", time), vectors("points", points)
    if t.shape != (len(p),):
        raise ConfigurationError("time", f"shape {t.shape}", f"({len(p)},), a time for each point")
    if len(t) < FEWEST:
        raise ConfigurationError("time", f"{len(t)} samples", f"at least {FEWEST}")
    steps = np.diff(t)
    if not (steps > 0).all():
        at = int(np.flatnonzero(~(steps > 0))[0]) + 1
        raise ConfigurationError(f"time[{at}]", float(t[at]), f"more than the {t[at - 1]:.9g} s before it")
    usual = float(np.median(steps))
    rate = 1.0 / usual if rate_hz is None else positive("rate_hz", rate_hz)
    notes = []
    jitter = float(np.median(np.abs(steps - usual)))
    gaps = steps[steps > usual + max(0.5 * usual, 4.5 * jitter)]
    if gaps.size:
        some = "a gap" if gaps.size == 1 else f"{gaps.size} gaps"
        notes.append(
            f"{some} of {milliseconds(gaps.min(), gaps.max())} (usual: {milliseconds(usual)}) bridged by straight "
            "lines: speed and smoothness there are not the person's"
        )
    duration = float(t[-1] - t[0])
    if abs(duration * rate - (len(t) - 1)) < 1e-3 and np.abs(steps - usual).max() <= 1e-3 * usual:
        return EvenSamples(t, p, (len(t) - 1) / duration, tuple(notes))
    count = int(np.floor(duration * rate + 1e-9)) + 1
    if count < FEWEST:
        raise ConfigurationError("time", f"{duration:.6g} s at {rate:.6g} Hz", f"at least {FEWEST} samples")
    if count > 100 * len(t) + 1000:
        expected = "a rate at most a hundred times the recording's (are the times in seconds, one gap longer than all?)"
        raise ConfigurationError("rate_hz", rate, expected)
    if not gaps.size and np.abs(steps - usual).max() > 0.05 * usual:
        notes.append(f"steps of {milliseconds(steps.min(), steps.max())} made even by linear interpolation")
    even = np.arange(count) / rate
    return EvenSamples(
        t[0] + even, np.column_stack([np.interp(even, t - t[0], column) for column in p.T]), rate, tuple(notes)
    )


def low_passed(points: ArrayLike, rate_hz: float, *, cutoff_hz: float | None = CUT_OFF_HZ) -> Array:
    """Points (N, d), sampled at `rate_hz` [Hz], low-passed at `cutoff_hz` without delay.

    A second-order Butterworth filter runs forward and back (fourth order, zero phase). Its cut-off is corrected for the
    two runs: Winter, "Biomechanics and Motor Control of Human Movement", 4th ed., 2009, ch. 3.

    Parameters
    ----------
    cutoff_hz : [Hz] frequency at which 0.707 of an amplitude remains; None for no filter.

    Raises
    ------
    ConfigurationError : fewer than ten points, numbers that are not finite, a cut-off of 0.4 of the rate or more, or
        below a millionth of it.
    """
    p, rate = vectors("points", points, fewest=FEWEST), positive("rate_hz", rate_hz)
    if cutoff_hz is None:
        return p
    if not positive("cutoff_hz", cutoff_hz) < MAX_CUT_OFF * rate:
        expected = f"less than {MAX_CUT_OFF:g} of the {rate:.6g} Hz of the samples, or None"
        raise ConfigurationError("cutoff_hz", cutoff_hz, expected)
    if cutoff_hz < SMALLEST_CUT_OFF * rate:
        expected = f"{SMALLEST_CUT_OFF:g} of the {rate:.6g} Hz of the samples, or more (are the times in seconds?)"
        raise ConfigurationError("cutoff_hz", cutoff_hz, expected)
    from scipy.signal import butter, sosfiltfilt  # noqa: PLC0415  (loads seconds of code)

    coefficients = butter(2, cutoff_hz / ONCE_EACH_WAY, fs=rate, output="sos")
    padding = min(len(p) - 1, 3 * int(np.ceil(rate / cutoff_hz)))
    return np.asarray(sosfiltfilt(coefficients, p, axis=0, padlen=padding))


def hand_velocity(points: ArrayLike, rate_hz: float, *, cutoff_hz: float | None = CUT_OFF_HZ) -> Array:
    """(N, d) [m/s] velocity of points (N, d) [m] at `rate_hz` [Hz]: `low_passed`, then central differences."""
    return np.asarray(np.gradient(low_passed(points, rate_hz, cutoff_hz=cutoff_hz), 1.0 / rate_hz, axis=0))


def white_noise(points: ArrayLike, smooth: ArrayLike, rate_hz: float, *, cutoff_hz: float) -> float:
    """Standard deviation [m] of the noise in each coordinate of points (N, d); the noise is assumed to be white.

    It is computed from the difference between the points and `smooth` (N, d), the points low-passed at `cutoff_hz`.
    """
    p, s = vectors("points", points), vectors("smooth", smooth)
    if p.shape != s.shape:
        raise ConfigurationError("smooth", f"shape {s.shape}", f"{p.shape}, as the points")
    passed, _ = passed_by_low_pass(rate_hz, cutoff_hz)
    return float(np.sqrt(((p - s) ** 2).mean() / ((1 - passed) ** 2).mean()))


def noise_of_derivative(noise: float, rate_hz: float, *, cutoff_hz: float | None, order: int) -> float:
    """Standard deviation [m/s^order] of a derivative of order 1 or 3 (jerk), caused by white noise of `noise` [m].

    The derivatives are those of `hand_velocity` and `dimensionless_jerk`: a central difference, then second
    differences.
    """
    passed, angle = passed_by_low_pass(rate_hz, cutoff_hz)
    differences = np.sin(angle) * (2 - 2 * np.cos(angle)) ** ((order - 1) // 2) * positive("rate_hz", rate_hz) ** order
    return float(noise * np.sqrt(((passed * differences) ** 2).mean()))


def passed_by_low_pass(rate_hz: float, cutoff_hz: float | None) -> tuple[Array, Array]:
    """Two results: gains of the low-pass that runs both ways (1 without a filter), and their frequencies [rad/sample].

    The frequencies go from 0 to half of the sampling rate.
    """
    angle = np.linspace(0.0, np.pi, FREQUENCIES)
    if cutoff_hz is None:
        return np.ones(FREQUENCIES), angle
    corner = np.pi * positive("cutoff_hz", cutoff_hz) / ONCE_EACH_WAY / positive("rate_hz", rate_hz)
    # Bilinear transform of the analogue filter: infinite frequency becomes half of the rate.
    passed = np.append(1 / (1 + (np.tan(angle[:-1] / 2) / np.tan(corner)) ** 4), 0.0)
    return passed, angle
