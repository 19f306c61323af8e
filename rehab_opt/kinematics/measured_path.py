"""Reconstruct the smooth path of a hand from tracker samples that are repeated, rounded or noisy.

A sample that a tracker repeats until the next one looks like a stop and a jump. Rounding, jitter of the time stamps,
and a tracker faster than its logger look like small jumps. All these errors have third differences a thousand times
larger than those of a hand's motion. Repeated samples are dropped. A rounded or noisy path is replaced by the path of
least jerk near its samples (Whittaker 1923, with third divided differences).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

__all__ = ["MeasuredPath", "measured_path"]

Array = NDArray[np.float64]

TIE = 1e-2
"""Two samples whose times are closer than this fraction of the mean step have one time; the second is kept."""
HELD, OFTEN, SHORT = 0.2, 3, 10
"""If a sample repeats for longer than `HELD` [s], or for more than `OFTEN` rows above the usual number, the hand
pauses. The usual number of rows is percentile `SHORT`, because samples of a slow hand with coarse rounding repeat,
too."""
GOES_ON, SLOW = 1.5, 0.1
"""The hand moved between two samples if their distance exceeds `GOES_ON` rounding steps. Without rounding, it must
exceed the fraction `SLOW` of the median distance."""
SMOOTHED = 9
"""Width, in samples, of the moving average of sample times, applied twice."""
FEWEST_DISTINCT = 4
"""Least number of samples that differ from the one before."""
FEWEST, DITHERS, MANY, SMALL, NEAR = 12, 0.1, 25, 4.0, 0.75
"""A coordinate is rounded if it has at least `FEWEST` different values, if more than the fraction `DITHERS` of its
changes have nonzero third differences, and if percentile `MANY` of these is at most `SMALL` rounding steps. The path
stays within `NEAR` steps of its samples."""
EXACT, FINEST = 1e-3, 1e-5
"""`EXACT` is the tolerance of a multiple of a rounding step, as a fraction of the step. `FINEST` is the smallest step,
as a fraction of the largest value, and the smallest noise, as a fraction of the range."""
NOISY, WHITE, BAND = (4, 6), 0.5, 4.0
"""`NOISY` are the orders of the two differences that show noise. `WHITE` is the least ratio of the second to the first;
it is 1 for white noise and below 1/2 for motion slower than a quarter of the sampling rate. The path stays within
`BAND` standard deviations of its samples."""
LOST = (2.0, 1.6, 2.7), (0.5, 0.37, 0.62)
"""Two cases (factor, least, largest). If the ratio of a step's speed to the speed beside it is between least and
largest, its duration is multiplied by the factor."""
STEADIER = 3.0
"""Corrected times are used if they reduce the changes of velocity by this factor."""
AROUND, OFTEN_SEEN, DEVIATIONS = 41, 80, 1.2816
"""`AROUND` is the number of samples in the window that shows a sample's noise. `OFTEN_SEEN` is the percentile taken in
it, because a few corners are not noise. `DEVIATIONS` is this percentile of |x| for a standard normal x."""
STIFFER, STIFFEST, BESIDE, PASSES = 3.0, 1e9, 9, 80
"""In each pass, the weight of samples outside the band grows by the factor `STIFFER`, at most to `STIFFEST`. `BESIDE`
is the width of the window of samples that get it, and `PASSES` the largest number of passes."""


class MeasuredPath(NamedTuple):
    """A path, and notes on how its samples were corrected."""

    times: Array
    """(M,) [s]"""
    points: Array
    """(M, n)"""
    notes: tuple[str, ...]
    """Empty if the path is unchanged."""


def measured_path(times: Array, points: Array) -> MeasuredPath:
    """Smooth path through points (N, n) at times (N,) [s]; unchanged if no sample is repeated, rounded or noisy.

    The first and last points, and pauses of more than 0.2 s, are kept. So are lost markers and spikes.
    """
    tied = np.append(np.diff(times) < TIE * (times[-1] - times[0]) / (len(times) - 1), False)
    said = (f"{tied.sum()} of {len(times)} samples have the time of the next: left out",) if tied.any() else ()
    times, points = times[~tied], points[~tied]
    begins = np.append(0, 1 + np.flatnonzero((np.diff(points, axis=0) != 0).any(axis=1)))
    if len(begins) < FEWEST_DISTINCT:
        return MeasuredPath(times, points, said)
    lengths, notes = np.diff(begins, append=len(times)), [*said]
    usual = int(np.percentile(lengths, SHORT, method="lower"))
    # The tracker gives a new sample every `usual` rows, also while the hand stands or is slower than its rounding.
    since = np.arange(len(times)) - np.repeat(begins, lengths)
    rows = np.flatnonzero((since == 0) | ((since % usual == 0) & (since <= np.repeat(lengths, lengths) - usual)))
    steps = np.maximum(_roundings(points[rows]), _roundings(points[begins]))
    rounded = steps > 0.0
    # If the hand moves on at once, the sample was repeated, because the next one was late or lost. Else the hand stood.
    hops = np.abs(np.diff(points[begins], axis=0))
    few = GOES_ON * steps[rounded] if rounded.any() else SLOW * np.median(hops.max(axis=1))
    far = np.pad(((hops[:, rounded] if rounded.any() else hops) > few).any(axis=1), 1)
    stood = np.append(times[begins[1:]], times[-1]) - times[begins]
    again = (stood <= HELD) & (lengths <= usual + OFTEN) & (far[1:] | far[:-1])
    rows = rows[(since == 0)[rows] | ~np.repeat(again, lengths)[rows]]
    moved = points[rows]
    clock = _clock(times, rows, moved)
    own = clock if len(rows) < len(times) else _faster(clock, moved)
    if own is not clock:
        notes.append("the tracker is faster than its logger: its own times are used")
    noise = np.where(rounded, 0.0, _noise(own, moved))
    if rounded.any():
        notes.append(
            f"positions rounded to {steps.max():.3g} m or rad: the path is the smoothest within {NEAR:g} of that"
        )
    if noise.any():
        notes.append(
            f"noise or jitter of up to {noise.max():.2g} m or rad: the path is the smoothest within {BAND:g} of it"
        )
    uneven = rounded | noise.any(axis=0)
    if uneven.any():
        moved[:, uneven] = _least_jerk(own, moved[:, uneven], np.maximum(BAND * noise, NEAR * steps)[:, uneven])
    if len(rows) < len(times) or own is not clock:
        from scipy.interpolate import CubicSpline  # noqa: PLC0415  (loaded when used)

        # With so few samples, a drive's own interpolation would stop at every extreme.
        moved, clock = np.asarray(CubicSpline(own, moved)(times[: rows[-1] + 1])), times[: rows[-1] + 1]
    if len(rows) < len(times):
        notes.append(f"{len(times) - len(rows)} of {len(times)} samples repeat the one before: left out")
    return MeasuredPath(clock, moved, tuple(notes))


def _clock(times: Array, rows: NDArray[np.intp], points: Array) -> Array:
    """(M,) [s] times of the samples in `rows` (M,): the logged ones, or a steady clock's if these are smoother."""
    own, even = times[rows], _averaged(rows.astype(np.float64))
    if np.abs(even - rows).max() > np.diff(rows, prepend=-1).min() + 0.5:
        return own
    even = np.interp(even, np.arange(len(times)), times)
    return even if _unsteady(even, points) < _unsteady(own, points) else own


def _faster(times: Array, points: Array) -> Array:
    """Times (N,) [s], corrected where a slow logger lost samples, if that makes the motion much steadier.

    If a step is twice as fast as the steps beside it, it spans two samples. The first and the last time are kept.
    """
    if len(times) < AROUND:
        return times
    speeds = np.diff(points, axis=0) / np.diff(times)[:, None]
    beside = np.pad(speeds, ((1, 1), (0, 0)), mode="reflect")
    beside = (beside[:-2] + beside[2:]) / 2
    ratio = (speeds * beside).sum(axis=1) / np.maximum((beside**2).sum(axis=1), 1e-30)
    others = []
    for factor, slowest, fastest in LOST:
        passed = np.append(
            0.0, np.cumsum(np.diff(times) * np.where((ratio > slowest) & (ratio < fastest), factor, 1.0))
        )
        others.append(times[0] + passed * (times[-1] - times[0]) / passed[-1])
    best = min(others, key=lambda each: _unsteady(each, points))
    return best if STEADIER * _unsteady(best, points) < _unsteady(times, points) else times


def _averaged(counts: Array) -> Array:
    """Row numbers (K,), smoothed as if the samples came at a steady clock; the first and last are kept."""
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415  (loaded when used)

    steps = uniform_filter1d(uniform_filter1d(np.diff(counts), SMOOTHED, mode="nearest"), SMOOTHED, mode="nearest")
    passed = np.append(0.0, np.cumsum(steps))
    return np.asarray(counts[0] + passed * (counts[-1] - counts[0]) / passed[-1])


def _unsteady(times: Array, points: Array) -> float:
    """Sum of the squared changes of velocity from step to step; infinite if the times do not increase."""
    steps = np.diff(times)
    if not np.all(steps > 0.0):
        return np.inf
    return float((np.diff(np.diff(points, axis=0) / steps[:, None], axis=0) ** 2).sum())


def _roundings(points: Array) -> Array:
    """(n,) rounding step of each column of points (N, n); 0 if it is negligible."""
    steps = [_rounding(axis) for axis in points.T]
    for i, axis in enumerate(points.T):  # an axis that hardly moves does not show its step alone
        steps[i] = steps[i] or max((each for each in steps if each and not _off(axis - axis[0], each)), default=0.0)
    return np.array(steps)


def _rounding(axis: Array) -> float:
    values = np.unique(axis)
    if len(values) < FEWEST:
        return 0.0
    apart, least = np.diff(values), FINEST * float(np.abs(values).max())
    step = float(apart.min())
    while step > least and (rest := apart - step * np.floor(apart / step + EXACT))[rest > EXACT * step].size:
        step = float(rest[rest > EXACT * step].min())
    if not step > least or _off(axis - axis[0], step):
        return 0.0
    bends = np.abs(np.diff(axis, 3)) / step
    bends = bends[bends > 0.5]
    return (
        step
        if len(bends) > DITHERS * np.count_nonzero(np.diff(axis)) and np.percentile(bends, MANY) <= SMALL + EXACT
        else 0.0
    )


def _off(ways: Array, step: float) -> bool:
    return bool(np.abs(ways / step - np.rint(ways / step)).max() > 0.1)


def _noise(times: Array, points: Array) -> Array:
    """(N, n) standard deviation of the noise in points (N, n); 0 where it is negligible.

    It is estimated from divided differences, scaled so that white noise gives its standard deviation.
    """
    from scipy.ndimage import maximum_filter1d, percentile_filter  # noqa: PLC0415  (loaded when used)

    if len(times) < AROUND:
        return np.zeros(points.shape)
    sizes = []
    for order in NOISY:
        apart = sliding_window_view(times, order + 1)
        factors = (apart[:, :, None] - apart[:, None, :]) * order / (apart[:, -1:] - apart[:, :1])[:, :, None]
        weights = 1.0 / (factors + np.eye(order + 1)).prod(axis=2)
        weights /= np.linalg.norm(weights, axis=1)[:, None]
        size = np.abs(np.einsum("ij,inj->in", weights, sliding_window_view(points, order + 1, axis=0)))
        size = np.pad(size, ((order // 2, order // 2), (0, 0)), mode="edge")
        sizes.append(percentile_filter(size, OFTEN_SEEN, size=(AROUND, 1), mode="nearest") / DEVIATIONS)
    found = maximum_filter1d(np.where(sizes[1] > WHITE * sizes[0], sizes[1], 0.0), AROUND, axis=0)
    return np.where(found.max(axis=0) > FINEST * np.ptp(points, axis=0), found, 0.0)


def _least_jerk(times: Array, points: Array, band: Array) -> Array:
    """(N, n) path of nearly least jerk (sum of squared third differences), within `band` (N, n) of points (N, n)."""
    from scipy.linalg import solveh_banded  # noqa: PLC0415  (loaded when used)
    from scipy.sparse import diags, identity  # noqa: PLC0415

    n, clock = len(times), (times - times[0]) / np.median(np.diff(times))
    third = identity(n, format="csr")
    for order in (1, 2, 3):
        third = diags(order / (clock[order:] - clock[:-order])) @ (third[1:] - third[:-1])
    price, close = (third.T @ third).tocsr(), np.full(n, 1e-12)
    banded = np.stack([np.pad(price.diagonal(k), (k, 0)) for k in (3, 2, 1, 0)])
    close[[0, -1]] = 1e6
    for _ in range(PASSES):
        path = np.asarray(solveh_banded(banded + np.pad(close[None], ((3, 0), (0, 0))), close[:, None] * points))
        far = (np.abs(path - points) > band).any(axis=1)
        if not far.any():
            break
        close[np.convolve(far, np.ones(BESIDE), "same") > 0] *= STIFFER
        close = np.minimum(close, STIFFEST)
    return np.where(np.abs(path - points) > band, points, path)
