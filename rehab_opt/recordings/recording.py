"""One recording of a hand or of joints: samples at increasing times, and what was noted on the way in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.text_file import shown, times

__all__ = ["Recording", "gap_notes", "size_note", "strange_sizes", "without_spikes"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of a movement at strictly increasing times.

    Parameters
    ----------
    file : where it comes from, as the user named it.
    time : (N,) [s], N >= 2.
    points : (N, 2) or (N, 3) positions [m] in the recording's own frame; (N, 0) where it has none.
    joints : joint angles [rad] by column name, (N,) each.
    forces : (N, 2) or (N, 3) [N] on the hand, in the frame of the points; (N, 0) where it has none.
    notes : what a reader of the result has to know: samples dropped, headers that do not hold, gaps.

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

    def __post_init__(self) -> None:
        """Check the times and freeze the arrays."""
        if len(self.time) < 2:
            raise ProblemFileError(self.file, "samples", len(self.time), "at least 2 usable samples")
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
        """The same recording with more notes."""
        return replace(self, joints=dict(self.joints), notes=(*self.notes, *notes))


BUNCHED = 0.1
"""Of the usual step: stamps that are nearer are those of when samples arrived, in bunches."""
ASIDE, HURLED = 0.02, 150.0
"""[m, m/s^2] No hand goes aside so far and comes back, so hard, from one sample to the next."""
FEW = 0.05
"""Share of the samples up to which such are left out: where there are more, it is the recording that is strange."""
LONG_STEP = 0.1, 5.0
"""[s] and of the usual steps, from which on a step is a gap."""


def without_spikes(recording: Recording) -> Recording:
    """Without the first of two samples whose stamps bunch, and without a sensor's spikes; notes say how many.

    Either would be a jump of who follows it, and a spike the largest extent of what is scaled to fit. What jumps and is
    no spike is noted.
    """
    if not recording.points.shape[1]:
        return recording
    steps = np.diff(recording.time)
    bunched = np.append(steps < BUNCHED * np.median(steps), False)  # the first of two came late, not the second early
    if bunched.mean() > FEW:
        bunched[:] = False
    kept, notes = _some(recording, ~bunched), []
    if bunched.any():
        notes.append(f"samples left out whose stamps bunch with the next: {int(bunched.sum())}")
    jumps = _jumps(kept.time, kept.points)
    spikes, after = _spikes(kept, jumps), kept.time - recording.time[0]
    if spikes.mean() > FEW:
        at = int(jumps.argmax())
        size = f"{1e3 * np.linalg.norm(kept.points[at + 1] - kept.points[at]):.3g} mm"
        notes.append(f"a jump that is no spike: {size} from one sample to the next, after {after[at + 1]:.3g} s")
    elif spikes.any():
        notes.append(f"samples left out as spikes: {int(spikes.sum())}, the first after {after[spikes.argmax()]:.3g} s")
        kept = _some(kept, ~spikes)
    return kept.noting(*notes)


def _spikes(recording: Recording, jumps: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) samples that are not of the hand: it is where most samples between jumps are, and where it goes from there.

    It goes on in the next samples that are more than those left out before them, and no jump.
    """
    parts = np.split(np.arange(len(recording.time)), np.flatnonzero(jumps) + 1)
    longest = int(np.argmax([len(part) for part in parts]))
    spikes = np.zeros(len(recording.time), dtype=bool)
    for way in (parts[longest:], [part[::-1] for part in parts[longest::-1]]):
        last, away = way[0], 0
        for part in way[1:]:
            four = [last[-4:][0], last[-1], part[0], part[:4][-1]]  # a velocity over one step would be the noise's
            if len(part) > away > 0 and not _jumps(recording.time[four], recording.points[four])[1]:
                last, away = part, 0
            else:
                spikes[part], away = True, away + len(part)
    return spikes


def _jumps(time: Array, points: Array) -> NDArray[np.bool_]:
    """(N - 1,) steps aside from where the velocity of the step before leads, that of the step after, and their mean."""
    steps, hops = np.diff(time), np.diff(points, axis=0)
    velocity = np.pad(hops / steps[:, None], ((1, 1), (0, 0)), mode="reflect")
    before, after = velocity[:-2], velocity[2:]
    off = np.min([np.linalg.norm(hops - v * steps[:, None], axis=1) for v in (before, after, (before + after) / 2)], 0)
    wide = np.abs(np.pad(steps, 1, mode="reflect"))
    seen = (wide[1:-1] + np.minimum(wide[:-2], wide[2:])) / 2
    return np.asarray((off > ASIDE) & (off > wide[1:-1] * np.minimum(HURLED * seen / 2, FASTEST)))


def gap_notes(recording: Recording) -> Iterator[str]:
    """A note on steps so long that a straight line bridges a movement."""
    steps = np.diff(recording.time)
    long = steps > max(LONG_STEP[0], LONG_STEP[1] * float(np.median(steps)))
    if long.any():
        at = float(recording.time[steps.argmax()] - recording.time[0])
        longest = f"the longest of {steps.max():.3g} s after {at:.3g} s"
        yield f"{times(int(long.sum()))} no samples, {longest}: bridged by straight lines"


def _some(recording: Recording, kept: NDArray[np.bool_]) -> Recording:
    joints = {name: values[kept] for name, values in recording.joints.items()}
    time, points, forces = (each[kept] for each in (recording.time, recording.points, recording.forces))
    return replace(recording, time=time, points=points, forces=forces, joints=joints)


SMALLEST, LARGEST = 5e-3, 2.5
"""[m] A movement of less is nobody's task; one of more, no arm's."""
FASTEST, SLOWEST = 4.0, 1e-3
"""[m/s] A hand is hardly faster for a tenth of its time but in sports, or slower throughout."""

MAX_TURN, SMALLEST_TURN = 4 * math.pi, math.radians(2.0)
"""[rad] No joint reads more; where none turns by as much, a movement of up to 115 deg is called degrees, in radians."""
UNEVEN, EVEN = 1.1, 1e-2
"""Of steps from sample to sample: the largest over the smallest, and how much they differ, over their mean."""


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
    """Notes on a movement so small, fast or slow that its lengths, angles or times are likely in another unit than it
    says, or whose times are likely in another column.
    """
    yield from _strange_angles(recording.joints)
    if not recording.points.shape[1]:
        return
    steps = np.diff(recording.time)
    for axis, along in zip("xyz", np.diff(recording.points, axis=0).T, strict=False):
        if steps.max() > UNEVEN * steps.min() and along.mean() > 0 and np.ptp(along) < EVEN * along.mean():
            yield f"{axis} grows by the same in each sample, and time does not: is one taken for the other?"
    extent, usual = float(np.ptp(recording.points, axis=0).max()), float(np.percentile(_speeds(recording), 90))
    if not extent:
        yield "the hand does not move at all: is it another column or marker?"
    elif extent < SMALLEST or extent > LARGEST:
        other = "larger" if extent < SMALLEST else "smaller"
        yield f"the whole movement is {1e3 * extent:.4g} mm large: is it in a {other} unit than its header says?"
    elif usual > FASTEST:
        yield f"a tenth of its samples is faster than {usual:.3g} m/s: are the times, or lengths, in another unit?"
    elif 0 < usual < SLOWEST:
        yield f"nine tenths of its samples are slower than {1e3 * usual:.3g} mm/s: milliseconds taken for seconds?"


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
