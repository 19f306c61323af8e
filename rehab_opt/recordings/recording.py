"""A recording of a hand or of joints: samples at increasing times, and notes."""

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
"""Name, start and end [s]."""


class Samples(NamedTuple):
    """Samples as in the file: NaN where the hand is missing, and possibly repeated times.

    Parameters
    ----------
    time, points, joints, forces, notes : as in `Recording`, to which `recording_of` converts them.
    rate : [Hz] from the file, or None.
    trials : name, first and last row of each.
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
    file : its name as the user gave it.
    time : (N,) [s], N >= 2.
    points : (N, 2) or (N, 3) positions [m] in the recording's own frame; (N, 0) without positions.
    joints : joint angles [rad] by column name, (N,) each.
    forces : (N, 2) or (N, 3) [N] on the hand, in the frame of the points; (N, 0) without forces.
    notes : remarks for readers of the result: dropped samples, wrong headers, gaps.
    trials : parts that the file separates; none by default.
    gaps : (from, to) [s] without the hand, where a straight line bridges a movement.

    Raises
    ------
    ProblemFileError : fewer than two samples, or times that do not increase.
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
        """Check the times and freeze the arrays."""
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
        """[s] from the first to the last sample."""
        return float(self.time[-1] - self.time[0])

    def noting(self, *notes: str) -> Recording:
        """The recording with more notes."""
        return replace(self, joints=dict(self.joints), notes=(*self.notes, *notes))

    def part(self, kept: NDArray[np.bool_] | slice) -> Recording:
        """The recording with some of its samples and all notes."""
        joints = {name: values[kept] for name, values in self.joints.items()}
        time, points, forces = (each[kept] for each in (self.time, self.points, self.forces))
        return replace(self, time=time, points=points, forces=forces, joints=joints)


BUNCHED = 0.1
"""Fraction of the usual step; stamps that are closer are arrival times of samples in bunches."""
ASIDE, HURLED = 0.02, 150.0
"""[m, m/s^2] Excursion and acceleration beyond which a single-sample jump is not the hand's."""
FEW = 0.05
"""Largest fraction of samples that are left out as spikes; with more, the recording itself is at fault."""
SPIKE = 12, 0.1
"""Longest spike, in samples and in [s], whichever is more; a longer one is a motion of the hand."""
LONG_STEP = 0.1, 5.0
"""Least length of a gap, in [s] and in usual steps."""
FEWEST_SEEN, ZEROED, NEAR = 10, 1.5, 10
"""Least number of other samples by which zeros are judged; least distance of a lost marker's zeros from the samples
beside them, as a multiple of the longest of the next 10 steps there."""
ENDLESS = 1e12
"""[m] No unit of length makes a position as large as this."""
LEVER = 0.3
"""[m] Radius, about a forearm's length, at which the turn of a joint is measured by the rules for the hand."""


def recording_of(file: str, samples: Samples, *, rate_hz: float | None = None) -> Recording:
    """Convert samples of any format to a recording with increasing times and no missing positions.

    Samples without the hand, or without an angle of joints alone, are left out with a note (a value is missing, or all
    are zero far from the neighbouring samples), as are all but the first sample at one time. Rounded even times become
    even; times that start again in each trial are moved behind the trial before.

    Parameters
    ----------
    rate_hz : [Hz] given by the user, in place of the times.

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
    """Times of samples whose clock starts again in some trials, one trial after the other; and all notes."""
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
    """(N,) flags of samples of points (N, d) without the hand.

    A coordinate is missing or beyond `ENDLESS`, or has a number that some systems write for a lost marker: all are zero
    or equal (-9999), or one is a repeated number beyond `FARTHEST` (9999999). Such samples must be further from those
    before and after than `ASIDE` and than `ZEROED` of their longest steps.
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
    """The recording without bunched samples and sensor spikes; notes count them.

    Either would make a follower jump, and a spike would dominate the extent when a recording is scaled. A spike has few
    samples; a jump that stays gives a note. Joint angles count as arcs of radius `LEVER`.
    """
    steps = np.diff(recording.time)
    bunched = np.append(steps < BUNCHED * np.median(steps), False)  # the first of two came late, not the second early
    if bunched.mean() > FEW:
        bunched[:] = False
    kept, notes, begun = recording.part(~bunched), [], recording.time[0]
    if bunched.any():
        notes.append(f"samples left out whose stamps bunch with the next: {int(bunched.sum())}")
    spikes = np.zeros(len(kept.time), dtype=bool)
    for _, path in _paths(kept):
        some = _spikes(kept.time, path, _jumps(kept.time, path))
        spikes |= some & (some.mean() <= FEW)
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
            notes.append(f"a jump that is no spike: {size}; {whose}")
    return kept.noting(*notes)


def _paths(recording: Recording) -> Iterator[tuple[str | None, Array]]:
    """The hand's path, and the arc (N, 1) [m] of each joint with its name."""
    if recording.points.shape[1]:
        yield None, recording.points
    for joint, angles in recording.joints.items():
        yield joint, np.asarray(LEVER * np.unwrap(angles)[:, None], dtype=np.float64)


def _spikes(time: Array, points: Array, jumps: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) flags of spikes; the hand is where most samples between jumps are.

    From there the hand continues, in both directions, with the next stretch that begins without a jump and is longer
    than the samples left out before it. If more samples are left out than a spike can have, they count as the hand.
    """
    parts = np.split(np.arange(len(time)), np.flatnonzero(jumps) + 1)
    longest = int(np.argmax([len(part) for part in parts]))
    spikes = np.zeros(len(time), dtype=bool)
    few = max(SPIKE[0], round(SPIKE[1] / float(np.median(np.diff(time)))))
    for way in (parts[longest:], [part[::-1] for part in parts[longest::-1]]):
        last, away = way[0], way[0][:0]
        for part in way[1:]:
            four = [last[-4:][0], last[-1], part[0], part[:4][-1]]  # a velocity over one step would be the noise's
            if len(part) > len(away) > 0 and (len(last) == 1 or not _jumps(time[four], points[four])[1]):
                last, away = part, part[:0]
            else:
                spikes[part], away = True, np.concatenate((away, part))
            if len(away) > few:
                spikes[away] = False
                last, away = part, part[:0]
    return spikes


def _jumps(time: Array, points: Array) -> NDArray[np.bool_]:
    """(N - 1,) flags of steps that differ from the extrapolation by the step before, the step after, and their mean."""
    steps, hops = np.diff(time), np.diff(points, axis=0)
    velocity = np.pad(hops / steps[:, None], ((1, 1), (0, 0)), mode="reflect")
    before, after = velocity[:-2], velocity[2:]
    off = np.min([np.linalg.norm(hops - v * steps[:, None], axis=1) for v in (before, after, (before + after) / 2)], 0)
    wide = np.abs(np.pad(steps, 1, mode="reflect"))
    seen = (wide[1:-1] + np.minimum(wide[:-2], wide[2:])) / 2
    return np.asarray((off > ASIDE) & (off > wide[1:-1] * np.minimum(HURLED * seen / 2, FASTEST)))


def within_reach(recording: Recording) -> Recording:
    """The recording; raises `ProblemFileError` for a coordinate that must be in another unit."""
    far = np.argwhere(np.abs(recording.points) > FARTHEST)
    if len(far):
        row, axis = (int(i) for i in far[0])
        where = f"sample {row + 1}, {'xyz'[axis]}, after {recording.time[row] - recording.time[0]:.3g} s"
        value = float(recording.points[row, axis])
        raise ProblemFileError(recording.file, where, value, f"at most {FARTHEST:g} m (another unit?)")
    return recording


def with_gaps(recording: Recording) -> Recording:
    """The recording with `gaps` set, and a note on them."""
    steps = np.diff(recording.time)
    long = steps > max(LONG_STEP[0], LONG_STEP[1] * float(np.median(steps)))
    gaps = tuple((float(recording.time[i]), float(recording.time[i + 1])) for i in np.flatnonzero(long))
    if not gaps:
        return recording
    longest = f"the longest of {steps.max():.3g} s after {recording.time[steps.argmax()] - recording.time[0]:.3g} s"
    note = f"gaps bridged by straight lines: {len(gaps)}, {longest}, {steps[long].sum():.3g} s in all"
    return replace(recording, joints=dict(recording.joints), gaps=gaps).noting(note)


SMALLEST, LARGEST = 5e-3, 2.5
"""[m] Usual range of a movement's extent."""
FASTEST, SLOWEST = 4.0, 1e-3
"""[m/s] Usual limits: largest speed exceeded for a tenth of the time, and least peak speed."""

MAX_TURN, SMALLEST_TURN = 4 * math.pi, math.radians(2.0)
"""[rad] Largest joint angle; smallest range of the largest joint movement, below which degrees were probably
radians."""
UNEVEN, EVEN = 1.1, 1e-2
"""Unevenness of steps between samples: ratio of largest to smallest, and deviation over the mean."""


def size_note(recording: Recording) -> str:
    """Samples, duration, extent and speed in one sentence."""
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
    """Notes on a movement whose size or speed suggests a wrong unit of lengths, angles or times."""
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
    """A note on a coordinate that is as even as times, for a complete recording."""
    steps = np.diff(recording.time)
    for axis, along in zip("xyz", np.diff(recording.points, axis=0).T, strict=False):
        if steps.max() > UNEVEN * steps.min() and along.mean() > 0 and np.ptp(along) < EVEN * along.mean():
            yield f"{axis} grows by the same in each sample, and time does not: is one taken for the other?"


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
    """(N - 1,) [m/s]"""
    steps = np.linalg.norm(np.diff(recording.points, axis=0), axis=1)
    return np.asarray(steps / np.diff(recording.time))
