"""Recordings of a hand or of joints: samples at increasing times, with notes on removed samples and gaps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.even_times import even_times
from rehab_opt.text_file import FARTHEST, shown

__all__ = [
    "Recording",
    "Samples",
    "recording_of",
    "size_note",
    "strange_sizes",
    "unseen",
    "with_gaps",
    "within_reach",
    "without_spikes",
]

Array = NDArray[np.float64]
Trial = tuple[str, float, float]
"""Name, start [s] and end [s] of a trial."""


class Samples(NamedTuple):
    """Samples as in a file, with NaN where the hand is missing, and possibly with repeated times.

    Parameters
    ----------
    time, points, joints, forces, notes : as in `Recording`.
    rate : sampling rate [Hz] in the file, or None.
    trials : name, first row and last row of each trial.
    """

    time: Array
    points: Array
    joints: Mapping[str, Array] = MappingProxyType({})
    forces: Array = np.empty((0, 0))
    notes: tuple[str, ...] = ()
    rate: float | None = None
    trials: tuple[tuple[str, int, int], ...] = ()


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of a movement at strictly increasing times.

    Parameters
    ----------
    file : name of the file as the user gave it.
    time : times (N,) [s], N >= 2.
    points : positions (N, 2) or (N, 3) [m] of the hand in the recording's frame; (N, 0) without positions.
    joints : joint angles (N,) [rad] by column name.
    forces : forces (N, 2) or (N, 3) [N] on the hand, in the frame of the points; (N, 0) without forces.
    notes : notes on dropped samples, wrong headers and gaps.
    trials : trials that the file separates; empty by default.
    gaps : times (from, to) [s] without samples of the hand, which straight lines bridge.

    Raises
    ------
    ProblemFileError : there are fewer than two samples, or times do not increase.
    """

    file: str
    time: Array
    points: Array
    joints: Mapping[str, Array] = field(default_factory=dict)
    forces: Array = field(default_factory=lambda: np.empty((0, 0)))
    notes: tuple[str, ...] = ()
    trials: tuple[Trial, ...] = ()
    gaps: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Check the times and make the arrays read-only."""
        if len(self.time) < 2:
            raise ProblemFileError(self.file, "samples", len(self.time), "at least 2 valid samples")
        back = np.flatnonzero(~(np.diff(self.time) > 0))
        if back.size:
            at = int(back[0]) + 1
            value, expected = f"{self.time[at]:.9g} s", f"more than the {self.time[at - 1]:.9g} s before it"
            raise ProblemFileError(self.file, f"time of sample {at + 1}", value, expected)
        if not self.forces.size:
            object.__setattr__(self, "forces", np.empty((len(self.time), 0)))
        for array in (self.time, self.points, self.forces, *self.joints.values()):
            array.flags.writeable = False
        object.__setattr__(self, "joints", MappingProxyType(dict(self.joints)))

    @property
    def duration(self) -> float:
        """Time [s] from the first to the last sample."""
        return float(self.time[-1] - self.time[0])

    def noting(self, *notes: str) -> Recording:
        """The recording with further notes."""
        return replace(self, joints=dict(self.joints), notes=(*self.notes, *notes))

    def part(self, kept: NDArray[np.bool_] | slice) -> Recording:
        """The recording with the selected samples only, and all notes."""
        joints = {name: values[kept] for name, values in self.joints.items()}
        time, points, forces = (each[kept] for each in (self.time, self.points, self.forces))
        return replace(self, time=time, points=points, forces=forces, joints=joints)


BUNCHED = 0.1
"""Fraction of the median step below which two time stamps are too close: the samples arrived in a bunch."""
ASIDE, HURLED = 0.02, 150.0
"""Distance [m] and acceleration [m/s^2] above which a jump between two samples is not a motion of the hand."""
FEW = 0.05
"""Largest fraction of samples that may be left out as spikes; with more, no sample is left out."""
SPIKE = 12, 0.1
"""Longest spike in samples and in [s], whichever is longer; a longer excursion is a motion of the hand."""
LONG_STEP = 0.1, 5.0
"""Shortest gap in [s] and in median steps, whichever is longer."""
FEWEST_SEEN, ZEROED, NEAR = 10, 1.5, 10
"""Three numbers that detect codes of a lost marker: smallest number of other samples; smallest distance from the
neighbouring samples, as a multiple of the longest nearby step; number of steps that count as nearby."""
ENDLESS = 1e12
"""Position [m] that is too large for any unit of length."""
LEVER = 0.3
"""Radius [m], about a forearm's length, that converts joint angles to arcs for the rules on positions of the hand."""


def recording_of(file: str, samples: Samples, *, rate_hz: float | None = None) -> Recording:
    """Convert samples of any format to a recording with increasing times and no missing positions.

    Samples without the hand are left out, with a note. So are samples that repeat the time of the sample before and, in
    a recording of joints alone, samples that lack an angle. Rounded times become even. If times start again in each
    trial, the times of each trial are shifted behind those of the trial before.

    Parameters
    ----------
    file : name of the file. samples : samples of the file.
    rate_hz : sampling rate [Hz] that the user gives in place of the file's times.

    Raises
    ------
    ProblemFileError : as `Recording`.
    """
    time, notes = _in_a_row(samples)
    time, rounded = even_times(time, samples.rate)
    if rate_hz is not None:
        time, rounded = np.arange(len(time)) / rate_hz, (f"ASSUMED: {rate_hz:g} samples a second, as stated",)
    hand, lost = samples.points.shape[1] > 0, unseen(samples.points)
    lost |= ~np.isfinite(samples.forces).all(axis=1) if samples.forces.size else False
    there = {name: np.isfinite(angles) for name, angles in samples.joints.items()}
    blind = [name for name, finite in there.items() if not (finite[~lost].all() if hand else finite.any())]
    joints = {name: angles for name, angles in samples.joints.items() if name not in blind}
    still = unseen(LEVER * np.column_stack([*joints.values()])) & ~lost if joints else np.zeros(len(time), dtype=bool)
    twice = np.zeros(len(time), dtype=bool)
    twice[np.flatnonzero(~(lost | still))[1:]] = np.diff(time[~(lost | still)]) == 0
    said = {
        "without the hand" + " or a force on it" * bool(samples.forces.size): lost,
        "without joint angles": still,
        "at the time of the one before": twice,
    }
    begun = np.append(time, math.nan)[0]
    for what, out in said.items():
        if out.any():
            usual = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
            notes.append(f"left out: {_many(int(out.sum()), usual)} {what}, the first after {_after(time, out, begun)}")
    if blind:
        missing = f"{'some' if hand else 'all'} of which are missing"
        notes.append(f"angles not read, {missing}: {shown(', '.join(blind), 120)}")
    kept = ~(lost | still | twice)
    forces = samples.forces[kept] if samples.forces.size else samples.forces
    return Recording(
        file=file,
        time=time[kept],
        points=samples.points[kept],
        joints={name: angles[kept] for name, angles in joints.items()},
        forces=forces,
        notes=(*notes, *rounded),
        trials=tuple((name, float(time[first]), float(time[last])) for name, first, last in samples.trials),
    )


def _in_a_row(samples: Samples) -> tuple[Array, list[str]]:
    """Two results: times that continue from trial to trial, even if the file's clock starts again; and all notes."""
    time, again = samples.time.copy(), 0
    for row in sorted({row for _, first, last in samples.trials for row in (first, last + 1)} - {0, len(time)}):
        if time[row] < time[row - 1]:
            time[row:] += math.floor(time[row - 1] - time[row]) + 2.0
            again += 1
    said = f"times that start again: {again}, each moved to 1 to 2 s after the trial before"
    return time, [*samples.notes, *([said] if again else [])]


def _many(count: int, step: float) -> str:
    return f"{count} sample{'s' if count > 1 else ''} ({count * step:.3g} s)"


def _after(time: Array, out: NDArray[np.bool_], begun: float) -> str:
    return f"{time[out.argmax()] - begun:.3g} s"


def unseen(points: Array) -> NDArray[np.bool_]:
    """Flags (N,) of the samples in which the hand is missing, for `points` (N, d).

    In such a sample, a coordinate is missing or beyond `ENDLESS`, or the coordinates are a code of a lost marker. In a
    code, all coordinates are zero or equal (-9999), or one is a repeated number beyond `FARTHEST` (9999999). Codes
    count only if they are far from the samples before and after.
    """
    lost: NDArray[np.bool_] = np.asarray(~(np.abs(points) < ENDLESS).all(axis=1))
    seen = np.flatnonzero(~lost)
    values, counts = np.unique(np.abs(points[seen])[np.abs(points[seen]) > FARTHEST], return_counts=True)
    equal = points[seen] == (points[seen, :1] if points.shape[1] > 1 else 0)
    zero = equal.all(axis=1) | np.isin(np.abs(points[seen]), values[counts > 1][-1:]).any(axis=1)
    rows = seen[~zero]
    if not zero.any() or len(rows) <= FEWEST_SEEN:
        return lost
    pace = np.linalg.norm(np.diff(points[rows], axis=0), axis=1) / np.diff(rows)
    for part in np.split(seen, np.flatnonzero(np.diff(zero.astype(np.int8))) + 1):
        k = int(np.searchsorted(rows, part[0]))
        beside = [(k - 1, part[0], pace[: max(k - 1, 0)][-NEAR:]), (k, part[-1], pace[k:][:NEAR])]
        lost[part] = zero[np.searchsorted(seen, part[0])] and all(
            np.linalg.norm(points[rows[i]] - points[at])
            > max(ASIDE, ZEROED * near.max(initial=0.0) * abs(rows[i] - at))
            for i, at, near in beside
            if 0 <= i < len(rows)
        )
    return lost


def without_spikes(recording: Recording) -> Recording:
    """The recording without sensor spikes and without samples whose time stamps are too close; notes count both.

    Such samples would make the tracking controller jump, and a spike would change the scale of a path that is fitted
    into a box. A spike has few samples; any other jump is kept, with a note. Joint angles are converted to arcs of
    radius `LEVER`.
    """
    steps = np.diff(recording.time)
    bunched = np.append(steps < BUNCHED * np.median(steps), False)  # of two close stamps, the first one is late
    if bunched.mean() > FEW:
        bunched[:] = False
    kept, notes, begun = recording.part(~bunched), [], recording.time[0]
    if bunched.any():
        notes.append(f"samples left out whose stamps bunch with the next: {int(bunched.sum())}")
    spikes, crowded = np.zeros(len(kept.time), dtype=bool), set[str | None]()
    for joint, path in _paths(kept):
        some = _spikes(kept.time, path, _jumps(kept.time, path))
        spikes |= some & (some.mean() <= FEW)
        crowded |= {joint} if some.mean() > FEW else set()
    if spikes.any():
        first = f"the first after {_after(kept.time, spikes, begun)}"
        notes.append(f"samples left out as spikes: {int(spikes.sum())}, {first}")
        kept = kept.part(~spikes)
    for joint, path in _paths(kept):
        hops = np.linalg.norm(np.diff(path, axis=0), axis=1)
        jumps = _jumps(kept.time, path)
        if jumps.any() and hops[jumps].max() > ASIDE:
            at = int((np.where(jumps, hops, 0) > hops[jumps].max() / 2).argmax())
            size = f"{1e3 * hops[at]:.3g} mm" if joint is None else f"{math.degrees(hops[at] / LEVER):.3g} deg"
            size = f"{size} from one sample to the next, after {kept.time[at + 1] - begun:.3g} s"
            whose = "speed and smoothness there are not the hand's" if joint is None else f"of {shown(joint)}"
            many = f"jumps are kept, as spikes would be more than {100 * FEW:g} % of the samples"
            notes.append(f"{many if joint in crowded else 'a jump that is no spike'}: {size}; {whose}")
    return kept.noting(*notes)


def _paths(recording: Recording) -> Iterator[tuple[str | None, Array]]:
    """Yield None and the hand's path (N, d) [m], then the name of each joint and its angles as arcs (N, 1) [m]."""
    if recording.points.shape[1]:
        yield None, recording.points
    for joint, angles in recording.joints.items():
        yield joint, np.asarray(LEVER * np.unwrap(angles)[:, None], dtype=np.float64)


def _spikes(time: Array, points: Array, jumps: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Flags (N,) of spikes. Jumps divide the path into parts, of which the longest is a motion of the hand.

    In both directions from the longest part, parts are spikes until one continues the hand's motion without a jump and
    has more samples than the spikes before it. Spikes that are too long count as a motion of the hand.
    """
    parts = np.split(np.arange(len(time)), np.flatnonzero(jumps) + 1)
    longest = int(np.argmax([len(part) for part in parts]))
    spikes = np.zeros(len(time), dtype=bool)
    few = max(SPIKE[0], round(SPIKE[1] / float(np.median(np.diff(time)))))
    for way in (parts[longest:], [part[::-1] for part in parts[longest::-1]]):
        last, away = way[0], way[0][:0]
        for part in way[1:]:
            four = [last[-4:][0], last[-1], part[0], part[:4][-1]]  # velocities over several steps have less noise
            if len(part) > len(away) > 0 and (len(last) == 1 or not _jumps(time[four], points[four])[1]):
                last, away = part, part[:0]
            else:
                spikes[part], away = True, np.concatenate((away, part))
            if len(away) > few:
                spikes[away] = False
                last, away = part, part[:0]
    return spikes


def _jumps(time: Array, points: Array) -> NDArray[np.bool_]:
    """Flags (N - 1,) of jumps: steps that neither the velocity before, nor that after, nor their mean explains."""
    steps, hops = np.diff(time), np.diff(points, axis=0)
    velocity = np.pad(hops / steps[:, None], ((1, 1), (0, 0)), mode="reflect")
    before, after = velocity[:-2], velocity[2:]
    off = np.min([np.linalg.norm(hops - v * steps[:, None], axis=1) for v in (before, after, (before + after) / 2)], 0)
    wide = np.abs(np.pad(steps, 1, mode="reflect"))
    seen = (wide[1:-1] + np.minimum(wide[:-2], wide[2:])) / 2
    return np.asarray((off > ASIDE) & (off > wide[1:-1] * np.minimum(HURLED * seen / 2, FASTEST)))


def within_reach(recording: Recording) -> Recording:
    """Return the recording; raise `ProblemFileError` if a coordinate is so large that its unit must be wrong."""
    far = np.argwhere(np.abs(recording.points) > FARTHEST)
    if len(far):
        row, axis = (int(i) for i in far[0])
        where = f"sample {row + 1}, {'xyz'[axis]}, after {recording.time[row] - recording.time[0]:.3g} s"
        value = float(recording.points[row, axis])
        raise ProblemFileError(recording.file, where, value, f"at most {FARTHEST:g} m (another unit?)")
    return recording


def with_gaps(recording: Recording) -> Recording:
    """The recording with `gaps` set, and a note on them; a pause between two trials is no gap."""
    begun, ended, steps = recording.time[:-1], recording.time[1:], np.diff(recording.time)
    long = steps > max(LONG_STEP[0], LONG_STEP[1] * float(np.median(steps)))
    for _, first, last in recording.trials:
        long &= ~((begun < first) & (ended >= first) | (begun <= last) & (ended > last))
    gaps = tuple((float(recording.time[i]), float(recording.time[i + 1])) for i in np.flatnonzero(long))
    if not gaps:
        return recording
    at = int(np.where(long, steps, 0.0).argmax())
    longest = f"the longest of {steps[at]:.3g} s after {recording.time[at] - recording.time[0]:.3g} s"
    note = f"gaps bridged by straight lines: {len(gaps)}, {longest}, {steps[long].sum():.3g} s in all"
    return replace(recording, joints=dict(recording.joints), gaps=gaps).noting(note)


SMALLEST, LARGEST = 5e-3, 2.5
"""Usual range [m] of a movement's extent."""
FASTEST, SLOWEST = 4.0, 1e-3
"""Usual range [m/s] of the 90th percentile of a movement's speed."""

MAX_TURN, SMALLEST_TURN = 4 * math.pi, math.radians(2.0)
"""Largest usual joint angle [rad]; smallest usual range [rad] of the joint that moves most. Beyond these values, the
unit of angles is probably wrong."""
UNEVEN, EVEN = 1.1, 1e-2
"""Ratio of largest to smallest step above which times are uneven; relative deviation below which steps are even."""


def size_note(recording: Recording) -> str:
    """Sentence with the number of samples, duration, extent, length and speed of a recording."""
    said = f"{len(recording.time)} samples over {recording.duration:.4g} s"
    if not recording.points.shape[1]:
        return said
    sides = " x ".join(f"{1e3 * side:.3g}" for side in np.ptp(recording.points, axis=0))
    speed = _speeds(recording)
    length = float(np.linalg.norm(np.diff(recording.points, axis=0), axis=1).sum())
    mean = length / recording.duration
    return f"{said}; {sides} mm large, {1e3 * length:.4g} mm long; mean speed {1e3 * mean:.3g} mm/s, p99 " + (
        f"{1e3 * np.percentile(speed, 99):.3g} mm/s"
    )


def strange_sizes(recording: Recording) -> Iterator[str]:
    """Notes on a size or speed that suggests a wrong unit of length, angle or time."""
    yield from _strange_angles(recording.joints)
    if not recording.points.shape[1]:
        return
    extent, usual = float(np.ptp(recording.points, axis=0).max()), float(np.percentile(_speeds(recording), 90))
    if not extent:
        yield "the hand does not move at all: is it another column or marker?"
    elif extent < SMALLEST or extent > LARGEST:
        other = "larger" if extent < SMALLEST else "smaller"
        yield f"the whole movement is {1e3 * extent:.4g} mm large: is its unit {other}?"
    elif usual > FASTEST:
        yield f"a tenth of its samples is faster than {usual:.3g} m/s: are the times, or lengths, in another unit?"
    elif 0 < usual < SLOWEST:
        yield f"nine tenths of its samples are slower than {1e3 * usual:.3g} mm/s: milliseconds taken for seconds?"


def exchanged_times(recording: Recording) -> Iterator[str]:
    """Note on a coordinate that grows evenly while times do not, as if the two columns were exchanged."""
    steps = np.diff(recording.time)
    for axis, along in zip("xyz", np.diff(recording.points, axis=0).T, strict=False):
        if steps.max() > UNEVEN * steps.min() and along.mean() > 0 and np.ptp(along) < EVEN * along.mean():
            yield f"{axis} grows evenly from sample to sample, but time does not: were the two columns exchanged?"


def _strange_angles(joints: Mapping[str, Array]) -> Iterator[str]:
    if not joints:
        return
    worst = max(joints, key=lambda joint: float(np.abs(joints[joint]).max()))
    largest = float(np.abs(joints[worst]).max())
    turn = max(float(np.ptp(angles)) for angles in joints.values())
    if largest > MAX_TURN:
        degrees = f"{math.degrees(largest):.4g} deg"
        yield f"{shown(worst, 40)} reads up to {largest:.3g} rad, {degrees}: degrees taken for radians, or no angles?"
    elif 0 < turn < SMALLEST_TURN:
        yield f"no joint turns by more than {math.degrees(turn):.3g} deg: radians taken for degrees?"


def _speeds(recording: Recording) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Speeds (N - 1,) [m/s] between the samples."""
    steps = np.linalg.norm(np.diff(recording.points, axis=0), axis=1)
    return np.asarray(steps / np.diff(recording.time))
