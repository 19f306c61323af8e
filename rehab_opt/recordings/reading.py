"""Recordings read from whatever file format, and resampled."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.c3d import read_c3d
from rehab_opt.recordings.markers import read_trc
from rehab_opt.recordings.motion_bids import read_motion
from rehab_opt.recordings.opensim import read_opensim
from rehab_opt.recordings.pen_trace import read_svc
from rehab_opt.recordings.recording import Recording, gap_notes, strange_sizes, without_spikes
from rehab_opt.recordings.tables import read_csv
from rehab_opt.recordings.xdf import read_xdf

__all__ = ["FORMATS", "read_recording", "resampled"]

Array = NDArray[np.float64]

FORMATS = (".csv", ".svc", ".mot", ".sto", ".trc", ".c3d", ".tsv", ".xdf")
MAX_SAMPLES = 200_000  # a longer path is far more likely a wrong time unit than a session


def read_recording(
    path: Path,
    *,
    name: str | None = None,
    columns: Sequence[str] | None = None,
    marker: str | None = None,
    separator: str = "comma",
    decimal: str = "point",
    count_mm: float | None = None,
    tick_ms: float | None = None,
    speed: float = 1.0,
    clean: bool = True,
) -> Recording:
    """Read a recording by its file's suffix.

    Parameters
    ----------
    path : a `.csv` with a header, a `.svc` pen trace, a `.mot`, `.sto`, `.trc`, `.c3d` or `_motion.tsv` motion
        capture, an `.xdf`.
    name : what to call the file in errors and notes; its path by default.
    columns : two or three columns that hold x, y (and z), of a `.csv`, `.mot`, `.sto` or `.xdf`.
    marker : which marker of a `.trc` or `.c3d`, or tracked point of a `_motion.tsv`, is the hand.
    separator, decimal : of a `.csv`: "comma", "semicolon" or "tab"; "point" or "comma".
    count_mm, tick_ms : [mm], [ms] what a raw count of a `.svc`, or of a `.csv` or `.c3d` without units, is.
    speed : of the recorded pace: 0.5 takes twice as long.
    clean : by `without_spikes`.

    Raises
    ------
    ProblemFileError : names the file, the line and column, the value, and what was expected.
    """
    name = name or str(path)
    for key, value in (("count_mm", count_mm), ("tick_ms", tick_ms), ("speed", speed)):
        if value is not None and not 0 < value < math.inf:
            raise ProblemFileError(name, f"recording.{key}", value, "a finite number above zero")
    readers: dict[str, Callable[[], Recording]] = {
        ".csv": lambda: read_csv(
            path, name=name, columns=columns, separator=separator, decimal=decimal, count_mm=count_mm, tick_ms=tick_ms
        ),
        ".mot": lambda: read_opensim(path, name=name, columns=columns),
        ".sto": lambda: read_opensim(path, name=name, columns=columns),
        ".svc": lambda: read_svc(path, name=name, count_mm=count_mm, tick_ms=tick_ms),
        ".trc": lambda: read_trc(path, name=name, marker=marker),
        ".c3d": lambda: read_c3d(path, name=name, marker=marker, count_mm=count_mm),
        ".xdf": lambda: read_xdf(path, name=name, columns=columns),
        ".tsv": lambda: read_motion(path, name=name, marker=marker),
    }
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise ProblemFileError(name, "file", path.name, f"a recording ending in {', '.join(FORMATS)}")
    recording = readers[suffix]()
    if speed != 1.0:
        paced = f"played at {speed:g} of its recorded speed"
        recording = replace(recording, time=recording.time / speed, joints=dict(recording.joints)).noting(paced)
    kept = without_spikes(recording) if clean else recording
    return kept.noting(*gap_notes(recording), *strange_sizes(kept))


def resampled(recording: Recording, rate: float) -> Recording:
    """The recording at a fixed rate, starting at time zero, by linear interpolation; its notes say so.

    Parameters
    ----------
    rate : [Hz] samples a second. At most one sample period at the end is left out.

    Raises
    ------
    ProblemFileError : the recording is shorter than one sample period, or so long that its times cannot be seconds.
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
        note = f"sampled unevenly, {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms apart"
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
    )
