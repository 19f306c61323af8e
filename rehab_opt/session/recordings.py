"""Recordings of a hand or of joints, whatever the file format, and what was done to them on the way in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError

__all__ = ["FORMATS", "Recording", "read_recording", "resampled"]

Array = NDArray[np.float64]

FORMATS = (".csv", ".svc", ".mot", ".trc")
MOST_SAMPLES = 200_000  # a longer path is far more likely a wrong time unit than a session


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


def read_recording(
    path: Path, *, name: str | None = None, columns: Sequence[str] | None = None, marker: str | None = None
) -> Recording:
    """Read a recording by its file's suffix.

    Parameters
    ----------
    path : a `.csv` with a header, a `.svc` pen trace, a `.mot` or a `.trc` motion-capture file.
    name : what to call the file in errors and notes; its path by default.
    columns : two or three columns that hold x, y (and z), of a `.csv` or `.mot`.
    marker : which marker of a `.trc` is the hand.

    Raises
    ------
    ProblemFileError : names the file, the line and column, the value, and what was expected.
    """
    from rehab_opt.session.markers import read_trc  # noqa: PLC0415  (the readers build on this module)
    from rehab_opt.session.pen_trace import read_svc  # noqa: PLC0415
    from rehab_opt.session.tables import read_csv, read_mot  # noqa: PLC0415

    name = name or str(path)
    readers: dict[str, Callable[[], Recording]] = {
        ".csv": lambda: read_csv(path, name=name, columns=columns),
        ".mot": lambda: read_mot(path, name=name, columns=columns),
        ".svc": lambda: read_svc(path, name=name),
        ".trc": lambda: read_trc(path, name=name, marker=marker),
    }
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise ProblemFileError(name, "file", path.name, f"a recording ending in {', '.join(FORMATS)}")
    return readers[suffix]()


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
    if not 1 <= wanted + 1e-9 <= MOST_SAMPLES:
        raise ProblemFileError(
            recording.file,
            "duration",
            f"{recording.duration:.6g} s",
            f"1 to {MOST_SAMPLES} samples at {rate:g} Hz (are the times in seconds?)",
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
