"""Pen traces of a tablet (.svc): a count, then x y [mm], time [s], pen-down, and columns that are not used here."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Recording
from rehab_opt.text_file import FARTHEST, LATEST, finite_number, shown, text_lines

__all__ = ["read_svc"]

COLUMNS = {"x_mm": 1e3 * FARTHEST, "y_mm": 1e3 * FARTHEST, "t_s": LATEST, "pen_down": math.inf}
"""Each with the largest number it may hold."""
DIGITS = 12  # a count with more is none, and Python refuses to read a very long one


def read_svc(path: Path, *, name: str, count_mm: float | None = None, tick_ms: float | None = None) -> Recording:
    """Pen trace, from the first to the last sample with the pen down.

    Samples with the pen up at either end are dropped (the hand is not at the task yet, or no more); those in between
    are kept, since the hand moves there too. Of samples with equal times the first is kept. Each is counted in the
    notes, and so is a count in the first line that does not hold.

    Parameters
    ----------
    count_mm, tick_ms : lengths and times are counts of so many mm, and of so many ms; mm and s by default.

    Raises
    ------
    ProblemFileError : what is no such trace, a time before the one above it, a pen that is never down.
    """
    lines = text_lines(path, name)
    stated = lines[0].strip()
    if not (stated.isascii() and stated.isdecimal()) or len(stated) > DIGITS:
        raise ProblemFileError(name, "line 1", shown(stated), "the number of samples")
    units = (count_mm or 1.0, count_mm or 1.0, 1e-3 * tick_ms if tick_ms else 1.0, 1.0)
    samples = np.empty((len(lines) - 1, len(COLUMNS)))
    for i, text in enumerate(lines[1:]):
        cells = text.split()
        if len(cells) < len(COLUMNS):
            raise ProblemFileError(name, f"line {i + 2}", shown(text), f"at least {', '.join(COLUMNS)}")
        for j, (column, most) in enumerate(COLUMNS.items()):
            number = finite_number(
                cells[j], name=name, line=i + 2, column=column, most=most / units[j],
                beyond="another unit? what a raw count is say recording.count_mm and recording.tick_ms",
            )  # fmt: skip
            samples[i, j] = number * units[j]
        if samples[i, 3] not in (0, 1):
            raise ProblemFileError(name, f"line {i + 2}, column pen_down", shown(cells[3]), "0 or 1")
        if i and samples[i, 2] < samples[i - 1, 2]:
            raise ProblemFileError(name, f"line {i + 2}, column t_s", shown(cells[2]), "a time not before the last one")
    recording = _trimmed(samples, name)
    if int(stated) == len(samples):
        return recording
    return recording.noting(f"its first line states {int(stated)} samples, {len(samples)} are there")


def _trimmed(samples: np.ndarray[tuple[int, ...], np.dtype[np.float64]], name: str) -> Recording:
    down = np.flatnonzero(samples[:, 3] == 1)
    if down.size == 0:
        raise ProblemFileError(name, "column pen_down", 0, "a pen that is down at least once")
    task = samples[down[0] : down[-1] + 1]
    kept = np.concatenate(([True], np.diff(task[:, 2]) > 0))
    notes = [
        f"dropped: {len(samples) - len(task)} samples with the pen up at the ends, "
        f"{np.count_nonzero(~kept)} with a repeated time",
        f"kept: {np.count_nonzero(task[kept, 3] == 0)} samples with the pen up between strokes, since the hand moves",
    ]
    time = task[kept, 2]
    return Recording(file=name, time=time, points=1e-3 * task[kept, :2], notes=tuple(notes))
