"""All measures of one trial."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import positive
from rehab_opt.measures.path import end_error, path_length, path_ratio, range_used, workspace_used
from rehab_opt.measures.samples import (
    CUT_OFF_HZ,
    FEWEST,
    MAX_CUT_OFF,
    EvenSamples,
    evenly_sampled,
    low_passed,
    milliseconds,
    noise_of_derivative,
    numbers,
    passed_by_low_pass,
    white_noise,
)
from rehab_opt.measures.speed import (
    RISE,
    dimensionless_jerk,
    log_dimensionless_jerk,
    mean_speed,
    movement_interval,
    peak_speed,
    spectral_arc_length,
    velocity_peaks,
)

__all__ = ["HandMotion", "Measure", "Score", "hand_motion", "score"]

Array = NDArray[np.float64]

STILL, HURLED = 1e-3, 50.0
"""[m/s] A hand that is always slower than `STILL` is at rest. If it is faster than `HURLED` for a tenth of the time,
the data have wrong units."""
SURE, NEVER = 4.5, 7.0
"""Speeds as multiples of the standard deviation that noise causes in each coordinate. With a resting hand in space, one
sample in 6000 exceeds the first speed and none the second."""
CHANCE = 0.7
"""If noise explains more than this fraction of the squared jerk, a note says "all", because the jerk of noise
varies."""
NORMAL_MEDIAN = 0.6745
"""Median of the magnitude of normal noise over its standard deviation."""
AXES = "xyz"


JERKS = tuple(f"{log}dimensionless_jerk{of}" for of in ("", "_of_speed") for log in ("", "log_"))
"""Names of the jerk measures: of the velocity, which includes turning, and of the speed, as in Balasubramanian et al.
2015."""


class Measure(NamedTuple):
    """One number of one trial; NaN if it cannot be measured, with the reason in the score's notes."""

    name: str
    value: float
    unit: str


class HandMotion(NamedTuple):
    """N low-passed samples of a hand at even times, and the speed threshold of movement."""

    even: EvenSamples
    path: Array
    """(N, d) [m]"""
    velocity: Array
    """(N, d) [m/s]"""
    speed: Array
    """(N,) [m/s]; at the ends, speeds that may be noise are zero."""
    cutoff_hz: float | None
    """Cut-off of the filter; None if the sampling is too slow for it."""
    noise: float
    """[m] Standard deviation of the noise in each coordinate."""
    shaken: float
    """[m/s] Largest apparent speed of a resting hand due to noise."""
    threshold: float
    """Fraction of the peak speed above which the hand moves: the argument, or more if noise exceeds it."""
    notes: tuple[str, ...]

    def goes(self, part: slice = slice(None)) -> bool:
        """Whether the hand moves further or faster during these samples than noise alone could make it seem."""
        far = range_used(self.path[part]).max() > 2 * SURE * self.noise
        return bool(far or self.speed[part].max() > NEVER / SURE * self.shaken)


class Score(NamedTuple):
    """Measures of a trial, its movement (M, d) [m] without rest before and after, and notes."""

    measures: tuple[Measure, ...]
    movement: Array
    notes: tuple[str, ...]


def score(
    time: ArrayLike,
    points: ArrayLike,
    *,
    target: ArrayLike | None = None,
    joints: Mapping[str, ArrayLike] | None = None,
    cutoff_hz: float = CUT_OFF_HZ,
    threshold: float = 0.05,
) -> Score:
    """Compute every measure of one trial: resample it evenly, low-pass it, cut it to the movement, and measure.

    Parameters
    ----------
    time : (N,) [s] increasing, N >= 10.
    points : (N, 2) or (N, 3) [m] of the hand.
    target : (2,) or (3,) [m] of the movement.
    joints : angles (N,) [rad] by name.
    cutoff_hz : cut-off of the filter (`hand_velocity`); samples too slow for it are not filtered, with a note.
    threshold : fraction of the peak speed at the movement's start and end (`movement_interval`); raised, with a note,
        if noise may exceed it.

    Returns
    -------
    Score : measures in SI units, joint ranges in deg. Speeds, peaks, smoothness and path are measured during the
        movement; the range and workspace used, and the end error, in the whole trial. The cut at 5 % of the peak speed
        shortens a movement: a minimum-jerk reach has a dimensionless jerk of 82 here, not of 204.8.

    Raises
    ------
    ConfigurationError : as `hand_motion`; a movement of fewer than ten samples.
    """
    motion = hand_motion(time, points, cutoff_hz=cutoff_hz, threshold=threshold)
    even, path, velocity, seen, cutoff, noise, shaken, least, _ = motion
    notes, rate = list(motion.notes), even.rate_hz
    begin, end = movement_interval(seen, rate, threshold=least)
    count = math.floor((end - begin) * rate) + 1
    if count < FEWEST:
        value = f"{count} samples, {milliseconds(end - begin)}"
        raise ConfigurationError("points", value, f"a movement of at least {FEWEST} samples")
    notes += _cut_notes(seen, least)
    rise = max(RISE, shaken)
    cut, asked = f"{100 * least:.2g}", f"{100 * threshold:.2g}"
    said = [f"the movement is cut at {cut} % of its peak speed, not {asked}, and the shorter for it"] * (cut != asked)
    said += [f"a velocity peak rises by {1e3 * rise:.2g} mm/s"] * (rise > RISE)
    if said:
        at = f"noise of {1e3 * noise:.2g} mm may move a hand at rest at {1e3 * shaken:.2g} mm/s"
        notes.append(f"{at}: {'; '.join(said)} (a lower cut-off may help)")
    moving, v = _between(path, rate, begin, end, count), _between(velocity, rate, begin, end, count)
    of_movement = (count - 1) / (end - begin)
    speed = np.linalg.norm(v, axis=1)
    jerks = [each(of, of_movement) for of in (v, speed) for each in (dimensionless_jerk, log_dimensionless_jerk)]
    t = numbers("time", time) - even.time[0]
    gap = float(np.diff(t)[(t[1:] > begin) & (t[:-1] < end)].max())  # longest time step that overlaps the movement
    if gap > max(1.5 / rate, 0.5 / cutoff_hz):
        jerks = [math.nan] * len(jerks)
        notes.append(f"dimensionless_jerk: not over a gap of {milliseconds(gap)}, which a straight line bridges")
    sharp = noise_of_derivative(noise, rate, cutoff_hz=cutoff, order=3)
    of_noise = (end - begin) ** 4 / peak_speed(v) ** 2 * v.shape[1] * sharp**2
    if of_noise > 0.2 * jerks[0]:
        fraction = "all" if of_noise > CHANCE * jerks[0] else f"{100 * of_noise / jerks[0]:.0f} %"
        notes.append(f"noise of {1e3 * noise:.2g} mm may make up {fraction} of dimensionless_jerk")
    measures = [
        Measure("duration", float(even.time[-1] - even.time[0]), "s"),
        Measure("movement_time", end - begin, "s"),
        Measure("speed_mean", mean_speed(v), "m/s"),
        Measure("speed_peak", peak_speed(v), "m/s"),
        Measure("velocity_peaks", velocity_peaks(speed, of_movement, rise=rise), "1"),
        Measure("sparc", spectral_arc_length(speed, of_movement), "1"),
        *(Measure(name, value, "1") for name, value in zip(JERKS, jerks, strict=True)),
        Measure("path_length", path_length(moving), "m"),
        Measure("path_ratio", _ratio(moving, notes), "1"),
    ]
    if target is not None:
        measures.append(Measure("end_error", end_error(path, target), "m"))
    for axis, extent in zip(AXES, range_used(path), strict=False):
        measures.append(Measure(f"range_{axis}", float(extent), "m"))
    plane = even.points.shape[1] == 2
    measures.append(
        Measure("workspace_area" if plane else "workspace_volume", workspace_used(path), "m^2" if plane else "m^3")
    )
    measures += _joint_ranges(joints or {})
    return Score(tuple(measures), moving, tuple(notes))


def hand_motion(
    time: ArrayLike, points: ArrayLike, *, cutoff_hz: float = CUT_OFF_HZ, threshold: float = 0.05
) -> HandMotion:
    """Separate movement from rest, in one trial or a whole recording; parameters as in `score`.

    Raises
    ------
    ConfigurationError : as `evenly_sampled`; a hand slower than 1 mm/s throughout, movement within the noise, more than
        50 m/s for a tenth of the time, or a cut-off above 10 Hz that is too high for the sampling.
    """
    even = evenly_sampled(time, points)
    if even.points.shape[1] not in (2, 3):
        raise ConfigurationError("points", f"shape {even.points.shape}", "(N, 2) or (N, 3)")
    usual = float(np.percentile(np.linalg.norm(np.diff(even.points, axis=0), axis=1), 90)) * even.rate_hz
    if usual > HURLED:
        value = f"faster than {usual:.3g} m/s a tenth of the time"
        raise ConfigurationError("points", value, f"at most {HURLED:g} m/s")
    notes = list(even.notes)
    rate, cutoff = even.rate_hz, _cutoff(even.rate_hz, cutoff_hz, notes)
    path = low_passed(even.points, rate, cutoff_hz=cutoff)
    velocity = np.gradient(path, 1.0 / rate, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    noise = _noise(even.points, path, rate, cutoff)
    shaken = SURE * noise_of_derivative(noise, rate, cutoff_hz=cutoff, order=1)
    seen = _above_noise(speed, noise, rate, cutoff)
    fastest = float(seen.max())
    part = max(threshold, min(shaken / max(fastest, STILL), 0.5))
    motion = HandMotion(even, path, velocity, seen, cutoff, noise, shaken, part, tuple(notes))
    if not (fastest > STILL and motion.goes()):
        expected = f"a hand that moves, at {1e3 * STILL:g} mm/s or more"
        if speed.max() > STILL:
            expected += f" and otherwise than noise of {1e3 * noise:.2g} mm makes one at rest (try a lower cut-off)"
        raise ConfigurationError("points", f"at most {1e3 * speed.max():.3g} mm/s", expected)
    return motion


def _noise(points: Array, path: Array, rate: float, cutoff: float | None) -> float:
    """[m] standard deviation of white noise, from what the filter removes (no filter: from fourth differences)."""
    if cutoff is not None:
        return white_noise(points, path, rate, cutoff_hz=cutoff)
    return float(np.median(np.abs(np.diff(points, 4, axis=0)))) / (NORMAL_MEDIAN * math.sqrt(70.0))


def _above_noise(speed: Array, noise: float, rate: float, cutoff: float | None) -> Array:
    """The speed, but zero near both ends where it may be noise: the filter does not reduce noise of end points."""
    passed, _ = passed_by_low_pass(rate, cutoff)
    least = SURE * 2 * noise * rate * float(passed.mean())
    seen = speed.copy()
    count = 1 if cutoff is None else math.ceil(0.5 * rate / cutoff)
    for part in (seen[:count], seen[-count:]):
        part[part < least] = 0.0
    return seen


def _between(samples: Array, rate: float, begin: float, end: float, count: int) -> Array:
    """`count` samples from `begin` to `end` [s], interpolated: jerk depends on the cube of the exact duration."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415

    return np.asarray(CubicSpline(np.arange(len(samples)) / rate, samples)(np.linspace(begin, end, count)))


def _cutoff(rate: float, cutoff_hz: float, notes: list[str]) -> float | None:
    if positive("cutoff_hz", cutoff_hz) < MAX_CUT_OFF * rate or cutoff_hz > CUT_OFF_HZ:
        return cutoff_hz  # `low_passed` raises an error if this filters nothing
    below = f"(one below {MAX_CUT_OFF * rate:.3g} Hz can be)"
    notes.append(f"sampled at {rate:.4g} Hz, too slowly for a low-pass at {cutoff_hz:g} Hz: not filtered {below}")
    return None


def _cut_notes(speed: Array, threshold: float) -> Iterator[str]:
    least = threshold * speed.max()
    for place, what in ((0, "begins"), (-1, "ends")):
        if speed[place] > least:
            fraction = 100 * speed[place] / speed.max()
            yield f"the trial {what} in motion, at {fraction:.0f} % of its peak speed: a part of it may be missing"


def _ratio(path: Array, notes: list[str]) -> float:
    length = path_length(path)
    if np.linalg.norm(path[-1] - path[0]) < 0.05 * length:
        notes.append("path_ratio: the movement ends where it began, so that there is no straight line to compare with")
        return math.nan
    return path_ratio(path)


def _joint_ranges(joints: Mapping[str, ArrayLike]) -> Iterator[Measure]:
    for name, angles in joints.items():
        # A jump by a whole turn is no motion: both numbers are the same angle.
        turned = np.unwrap(numbers(f"joints[{name!r}]", angles))
        yield Measure(f"range_{name}", math.degrees(float(range_used(turned)[0])), "deg")
