"""Restore evenly spaced times that a recording has rounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["even_times"]

Array = NDArray[np.float64]

FINEST, COARSEST, EVENLY, BEATS = -6, -1, 1e-3, 10
"""Finest and coarsest rounding of times, as exponents of ten [s]; smallest rounding error that matters, as a fraction
of a step; number of long steps from which a coarse clock, not missing rows, explains them."""


def even_times(time: Array, rate: float | None) -> tuple[Array, tuple[str, ...]]:
    """Two results: the times (N,) [s], made even if they are even times that were rounded; and notes.

    At 240 Hz, times with three decimals have steps of 4 and 5 ms, which would cause false accelerations. Times count as
    rounded if all of them agree with even times to their number of decimals, or to the step of a coarser clock.

    Parameters
    ----------
    time : times (N,) [s] in the file. rate : rate [Hz] in the file; by default the rate is found from the times.
    """
    said: tuple[str, ...] = ()
    if len(time) < 3 or not np.isfinite(time).all() or not (np.diff(time) >= 0).all() or time[-1] == time[0]:
        return time, said
    t = time - time[0]
    units = 10.0 ** np.arange(COARSEST, FINEST - 1, -1)
    unit = next((each for each in units if np.abs(t - each * np.rint(t / each)).max() < 1e-3 * each + 1e-6), 0.0)
    steps, rows = np.diff(t), np.arange(len(t), dtype=np.float64)
    ahead, mean = np.sort(steps[steps > 0]), t[-1] / rows[-1]
    apart = np.diff(ahead)[np.diff(ahead) > max(0.5 * unit, EVENLY * ahead[0])]
    unit = max(unit, _clock(t, float(apart.min()), unit) if apart.size else 0.0)
    clock = max(unit, _clock(t, float(ahead[0]), unit))
    held = (steps == 0).sum() > max(2, 0.1 * len(steps))
    beats = steps.min() > 0 and 1.05 * clock < mean < 1.9 * clock and (steps > 1.5 * clock).sum() >= BEATS
    unit = clock if held or beats else unit
    if rate is not None and np.ptp(steps) > EVENLY * mean:  # even times are not rounded, whatever the header states
        # Times rounded to more than a sample's duration do not show missing rows: the rate then holds for all rows.
        count = rows if unit * rate > 1.01 else np.rint(t * rate)
        agrees = np.ptp(t - count / rate) <= max(1.1 * unit, EVENLY / rate)
        if agrees and np.median(np.diff(count)) == 1 and (np.diff(count) > 0).all():
            return _even(time, count, 1 / rate, unit)
    usual = float(np.median(steps))
    near = steps[np.abs(steps - usual) <= 0.5 * usual]
    usual = float(near.mean()) if usual > 0 and near.size else t[-1] / rows[-1]
    counts = [np.append(0.0, np.cumsum(np.rint(steps / usual)))] if usual > 1.01 * unit else []
    few = 1.05 * unit < usual < 1.9 * unit and steps.min() > 0
    if few or held or beats:
        counts.append(rows)  # the times are too coarse to tell missing rows: try even times without missing rows
    for count in counts if unit else ():
        step = float(np.polyfit(count, t, 1)[0]) if (np.diff(count) > 0).all() else 0.0
        if step > 0 and np.ptp(t - count * step) <= 1.1 * unit:
            (time, said), usual = _even(time, count, step, unit), step
            break
    if rate is not None and abs(rate * usual - 1) > 0.02:
        said = (*said, f"its header states {rate:g} Hz, its times have {1 / usual:.4g} Hz")
    return time, said


def _clock(t: Array, about: float, unit: float) -> float:
    """Step [s], near `about`, whose whole multiples agree with the times `t` to within `unit`; 0 if there is none."""
    steps = np.diff(t)
    ends, near = np.cumsum(steps), steps[(steps > 0.5 * about) & (steps < 1.5 * about)]
    counts = np.cumsum(np.rint(steps / (near.mean() if near.size else about)))
    if not counts[-1] > counts[0]:
        return 0.0
    step = float(np.polyfit(counts, ends, 1)[0])
    return step if np.ptp(ends - step * counts) <= max(1.1 * unit, EVENLY * step) else 0.0


def _even(time: Array, count: Array, step: float, unit: float) -> tuple[Array, tuple[str, ...]]:
    even = time[0] + count * step
    if np.abs(np.diff(time) - np.diff(even)).max() <= EVENLY * step:
        return time, ()
    return even, (f"times written to {1e3 * unit:g} ms are those of {1 / step:.5g} Hz",)
