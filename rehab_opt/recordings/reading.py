"""Read and resample recordings of any supported format."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.c3d import read_c3d
from rehab_opt.recordings.markers import read_trc
from rehab_opt.recordings.motion_bids import read_motion
from rehab_opt.recordings.opensim import read_opensim
from rehab_opt.recordings.pen_trace import read_svc
from rehab_opt.recordings.recording import (
    Recording,
    Samples,
    exchanged_times,
    recording_of,
    strange_sizes,
    with_gaps,
    within_reach,
    without_spikes,
)
from rehab_opt.recordings.tables import read_csv
from rehab_opt.recordings.units import Reading
from rehab_opt.recordings.xdf import read_xdf

__all__ = ["FORMATS", "read_recording", "resampled"]

Array = NDArray[np.float64]

MAX_SAMPLES = 200_000  # a path with more samples probably has a wrong unit of time


_X, _Y, _Z = np.eye(3)
UPWARDS: Mapping[str, tuple[Array, ...]] = MappingProxyType({
    "z": (_X, _Y, _Z), "y": (_X, -_Z, _Y), "x": (-_Z, _Y, _X),
    "-z": (_X, -_Y, -_Z), "-y": (_X, _Z, -_Y), "-x": (_Z, _Y, -_X),
})  # fmt: skip
"""Rows of the rotation that turns a recording so that the given axis, which points up, becomes z."""
READERS: Mapping[str, Callable[..., Samples]] = MappingProxyType({
    ".csv": read_csv, ".svc": read_svc, ".mot": read_opensim, ".sto": read_opensim, ".trc": read_trc, ".c3d": read_c3d,
    ".tsv": read_motion, ".xdf": read_xdf,
})  # fmt: skip
FORMATS = tuple(READERS)


def read_recording(
    path: Path,
    *,
    name: str | None = None,
    speed: float = 1.0,
    up: str | None = None,
    window_s: Sequence[float] | None = None,
    clean: bool = True,
    by_trial: bool = False,
    **reading: Any,
) -> Recording:
    """Read a recording; the file's suffix selects the format.

    Parameters
    ----------
    path : path of a `.csv` table, a `.svc` pen trace, an `.xdf` file, or motion capture in a `.mot`, `.sto`, `.trc`,
        `.c3d` or `_motion.tsv` file.
    name : name of the file in errors and notes; by default its path.
    speed : playback speed; at 0.5 the movement takes twice as long.
    up : the recording's axis that points up, such as "y"; the points are rotated so that z points up.
    window_s : window (from, to) [s] after the first sample; samples outside the window are left out.
    clean : whether sensor spikes are removed with `without_spikes`.
    by_trial : whether the caller checks each trial with `within_reach`, so that one with a wrong unit fails alone.
    reading : further settings, the fields of `Reading`, such as columns, marker and units.

    Raises
    ------
    ProblemFileError : the content is invalid; the message names file, line, column, value and expected values.
    """
    name, how = name or str(path), Reading(**reading)
    if not 0 < speed < math.inf:
        raise ProblemFileError(name, "recording.speed", speed, "a finite number above zero")
    if up is not None and up not in UPWARDS:
        raise ProblemFileError(name, "recording.up", up, f"one of {', '.join(UPWARDS)}")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise ProblemFileError(name, "file", path.name, f"a recording ending in {', '.join(FORMATS)}")
    how.check(name, suffix)
    samples = READERS[suffix](path, name=name, how=how)
    unused = [f"units that nothing in it has are not used: {', '.join(how.unused())}"] if how.unused() else []
    samples = samples._replace(notes=(*samples.notes, *how.told, *unused))
    recording = recording_of(name, samples, rate_hz=how.rate_hz)
    if window_s is not None:
        recording = _within(recording, window_s)
    if up not in (None, "z"):
        recording = _turned(recording, up)
    if speed != 1.0:
        trials = tuple((trial, first / speed, last / speed) for trial, first, last in recording.trials)
        paced = f"played at {speed:g} of its recorded speed"
        recording = replace(recording, time=recording.time / speed, joints=dict(recording.joints), trials=trials)
        recording = recording.noting(paced)
    kept = without_spikes(recording) if clean else recording
    if not (by_trial and kept.trials):
        kept = within_reach(kept)
    if len(kept.time) < len(recording.time):
        seconds = (len(recording.time) - len(kept.time)) * float(np.median(np.diff(recording.time)))
        kept = kept.noting(f"that leaves out {seconds:.3g} s of {recording.duration:.4g} s")
    kept = with_gaps(kept)
    return kept.noting(*exchanged_times(recording), *strange_sizes(kept))


def _within(recording: Recording, window_s: Sequence[float]) -> Recording:
    time = recording.time - recording.time[0]
    kept = (time >= window_s[0]) & (time <= window_s[-1])
    if len(window_s) != 2 or np.count_nonzero(kept) < 2:
        expected = f"two times from 0 to {time[-1]:.6g} s after the first sample, with samples between them"
        raise ProblemFileError(recording.file, "recording.window_s", list(window_s), expected)
    return recording.part(kept).noting(f"read from {window_s[0]:g} to {window_s[1]:g} s after its first sample alone")


def _turned(recording: Recording, up: str) -> Recording:
    if recording.points.shape[1] != 3:
        value, expected = f"{up}, of {recording.points.shape[1]} coordinates", "no such key: only three have an up"
        raise ProblemFileError(recording.file, "recording.up", value, expected)
    turn = np.array(UPWARDS[up]).T
    forces = recording.forces @ turn if recording.forces.shape[1] == 3 else recording.forces
    turned = replace(recording, points=recording.points @ turn, forces=forces, joints=dict(recording.joints))
    return turned.noting(f"rotated so that its {up} axis, which points up, becomes z")


def resampled(recording: Recording, rate: float) -> Recording:
    """The recording, resampled to a fixed rate from time zero by linear interpolation, with a note.

    Parameters
    ----------
    recording : recording to resample. rate : sampling rate [Hz]. At most one sampling period is lost at the end.

    Raises
    ------
    ProblemFileError : the recording is shorter than one sampling period, or would have more than 200 000 samples.
    """
    wanted = recording.duration * rate
    if not 1 <= wanted + 1e-9 <= MAX_SAMPLES:
        raise ProblemFileError(
            recording.file,
            "duration",
            f"{recording.duration:.6g} s",
            f"1 to {MAX_SAMPLES} samples at {rate:g} Hz (are the times in seconds?)",
        )
    time = np.arange(int(np.floor(wanted + 1e-9)) + 1) / rate
    source = recording.time - recording.time[0]
    points, forces = (
        np.array([np.interp(time, source, column) for column in values.T]).reshape(values.shape[1], len(time)).T
        for values in (recording.points, recording.forces)
    )
    steps = np.diff(recording.time)
    usual = float(np.median(steps))
    if np.abs(steps - usual).max() > 0.01 * usual:
        longest = f"{1e3 * steps.max():{'.3g' if steps.max() < 1 else '.0f'}}"
        note = f"sampled unevenly, {1e3 * steps.min():.3g} to {longest} ms apart"
    else:
        note = f"sampled at {1 / usual:.4g} Hz"
    if note != f"sampled at {rate:.4g} Hz":
        note += f"; resampled to {rate:g} Hz by linear interpolation"
    return Recording(
        file=recording.file,
        time=time,
        points=points,
        joints={name: np.interp(time, source, values) for name, values in recording.joints.items()},
        forces=forces,
        notes=(*recording.notes, note),
        gaps=tuple((first - recording.time[0], last - recording.time[0]) for first, last in recording.gaps),
    )
