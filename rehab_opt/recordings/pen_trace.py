"""Read pen traces of a tablet (.svc): a line with the number of samples, then rows of x, y, time and pen state."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Samples
from rehab_opt.recordings.units import Reading
from rehab_opt.text_file import LATEST, finite_number, shown, text_lines

__all__ = ["read_svc"]

COLUMNS = ("x_mm", "y_mm", "t_s", "pen_down")
DIGITS = 12  # largest number of digits of the number of samples; Python cannot read very long numbers
STRAIGHT = 20
"""Number of samples from which positions in whole numbers count as raw counts of the tablet."""


def read_svc(path: Path, *, name: str, how: Reading) -> Samples:
    """Path (N, 2) [m] of the pen from the first to the last sample with the pen down.

    Samples with the pen up at the beginning and end are dropped, because the task has not begun or is over. Samples
    with the pen up between two strokes are kept. Lengths are in mm and times in s unless the user states other units.
    Whole numbers are raw counts, whose unit the user must state.

    Raises
    ------
    ProblemFileError : the file is not a pen trace, raw counts have no unit, times decrease, or the pen is never down.
    """
    lines = text_lines(path, name)
    stated = lines[0].strip()
    if not (stated.isascii() and stated.isdecimal()) or len(stated) > DIGITS:
        raise ProblemFileError(name, "line 1", shown(stated), "the number of samples")
    length, tick = (
        how.factor(kind, "" if how.counted(kind) else unit, name=name, where=column)
        for kind, unit, column in (("length", "mm", "x_mm"), ("time", "s", "t_s"))
    )
    most = (math.inf, math.inf, LATEST / tick, math.inf)
    samples = np.empty((len(lines) - 1, len(COLUMNS)))
    for i, text in enumerate(lines[1:]):
        cells = text.split()
        if len(cells) < len(COLUMNS):
            raise ProblemFileError(name, f"line {i + 2}", shown(text), f"at least {', '.join(COLUMNS)}")
        for j, column in enumerate(COLUMNS):
            samples[i, j] = finite_number(
                cells[j], name=name, line=i + 2, column=column, most=most[j],
                beyond="another unit? what a raw count is say recording.count_mm and recording.tick_ms",
            )  # fmt: skip
        if samples[i, 3] not in (0, 1):
            raise ProblemFileError(name, f"line {i + 2}, column pen_down", shown(cells[3]), "0 or 1")
        if i and samples[i, 2] < samples[i - 1, 2]:
            raise ProblemFileError(name, f"line {i + 2}, column t_s", shown(cells[2]), "a time not before the last one")
    _check_counts(samples, how, name)
    down = np.flatnonzero(samples[:, 3] == 1)
    if down.size == 0:
        raise ProblemFileError(name, "column pen_down", 0, "a pen that is down at least once")
    task = samples[down[0] : down[-1] + 1]
    ends, between = len(samples) - len(task), int(np.count_nonzero(task[:, 3] == 0))
    notes = [f"dropped: {ends} samples with the pen up at the ends"] if ends else []
    notes += [f"kept: {between} samples with the pen up between strokes, as parts of the movement"] if between else []
    if int(stated) != len(samples):
        notes.append(f"its first line states {int(stated)} samples, {len(samples)} are there")
    return Samples(tick * task[:, 2], length * task[:, :2], notes=tuple(notes))


def _check_counts(samples: np.ndarray[tuple[int, ...], np.dtype[np.float64]], how: Reading, name: str) -> None:
    """Raise an error for raw counts without a stated unit: whole millimetres, or steps of whole seconds."""
    whole = (samples == np.rint(samples)).all(axis=0)
    seconds = len(samples) > 1 and whole[2] and float(np.median(np.diff(samples[:, 2]))) >= 1
    asked = {
        key: unit
        for key, unit, kind, raw in (
            ("count_mm", "mm", "length", whole[:2].all() and (seconds or len(samples) >= STRAIGHT)),
            ("tick_ms", "ms", "time", seconds),
        )
        if raw and how.counted(kind) is None and not (kind == "time" and how.rate_hz)
    }
    if asked:
        place, what = (slice(2, 3), "times") if [*asked] == ["tick_ms"] else (slice(0, 3), "x, y and time")
        value = " ".join(f"{x:g}" for x in samples[:3, place].ravel()) + " ..."
        keys, units = " and ".join(f"recording.{key}" for key in asked), " and ".join(asked.values())
        expected = f"what a raw count is: {keys}, or recording.units (such as {units})"
        raise ProblemFileError(name, f"{what} in whole numbers", value, expected)
