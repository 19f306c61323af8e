"""Recordings of hand poses, as virtual reality trackers write them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.tables import MISSING, SEPARATORS, marks, numbers_below
from rehab_opt.session.mirror.problem import PoseRecordingSection
from rehab_opt.session.outcome import Array
from rehab_opt.text_file import LATEST, header_cells, shown, text_lines

HEADER = ("t_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
POINTS = ("vr_x_m", "vr_y_m", "vr_z_m", "robot_x_m", "robot_y_m", "robot_z_m")
FAR = 10.0
"""[m] Largest coordinate of a hand; a larger one is probably in another unit."""


@dataclass(frozen=True, eq=False)
class HandPoses:
    """N samples as recorded; samples that the tracker lost may be NaN.

    Parameters
    ----------
    times : (N,) [s]
    positions, quaternions : (N, 3) in the recording's unit of length, and (N, 4) x, y, z, w.
    notes : notes for a reader of the result.
    """

    times: Array
    positions: Array
    quaternions: Array
    notes: tuple[str, ...]


def read_hand_poses(path: Path, section: PoseRecordingSection, *, file: str) -> HandPoses:
    """Read hand poses by the header `t_s,x_m,y_m,z_m,qx,qy,qz,qw`, or by column numbers from a file without a header.

    An empty or nan cell means that the tracker had lost the hand. The separator is found as by `read_csv`.

    Parameters
    ----------
    file : name of the problem file, for errors about its keys.
    """
    name = section.file
    lines = text_lines(path, name)
    marked = marks(lines[0], section.separator, section.decimal, name=name)
    if section.position_columns is not None and section.quaternion_columns is not None:
        width = len(header_cells(lines[0].split(marked[0]), name=name, line=1))
        for key in ("position_columns", "quaternion_columns"):
            for column in getattr(section, key):
                if column > width:
                    raise ProblemFileError(file, f"recording.{key}", column, f"a column from 1 to {width} of {name}")
        header = [str(number) for number in range(1, width + 1)]
        wanted = [str(column) for column in (*section.position_columns, *section.quaternion_columns)]
        table, stamped = _numbers(lines, header, wanted, marked, name=name, first=1), False
    else:
        stamped = section.rate_hz is None
        table = _below(lines, HEADER if stamped else HEADER[1:], marked, name=name)
    notes: list[str] = []
    if section.rows is not None:
        first, last = section.rows
        if last > len(table):
            raise ProblemFileError(file, "recording.rows", section.rows, f"rows from 1 to {len(table)}")
        notes.append(f"rows {first} to {last} of the recording's {len(table)}")
        table = table[first - 1 : last]
    if stamped:
        times, table = table[:, 0], table[:, 1:]
        if np.any(np.abs(times) > LATEST):
            raise ProblemFileError(name, "column t_s", float(np.abs(times).max()), f"times up to {LATEST:g} s")
    else:
        assert section.rate_hz is not None  # the schema requires it
        times = np.arange(len(table)) / section.rate_hz
        notes.append(
            f"ASSUMED: {section.rate_hz:g} samples a second; the recording has no time stamps, and every speed and "
            "time rests on this"
        )
    farthest = np.abs(table[:, :3])
    if np.any(farthest > FAR):
        row = int(np.argmax(np.any(farthest > FAR, axis=1))) + 1
        raise ProblemFileError(
            name, f"sample {row}", float(np.nanmax(farthest)), f"positions up to {FAR:g} m (another unit?)"
        )
    lost = int(np.sum(~np.all(np.isfinite(table), axis=1)))
    if lost:
        notes.append(f"{lost} of {len(table)} samples hold no pose: the tracker had lost the hand")
    return HandPoses(times, table[:, :3], table[:, 3:], tuple(notes))


def calibration_points(path: Path, *, name: str) -> tuple[Array, Array]:
    """Two arrays (N, 3) [m] of corresponding points, in the recording's frame and in the robot's frame."""
    lines = text_lines(path, name)
    mark = next((each for each in SEPARATORS.values() if each and each in lines[0]), ",")
    point = "," if mark != "," and any("," in line for line in lines[1:]) else "."
    table = _below(lines, POINTS, (mark, point), name=name)
    if not np.all(np.abs(table) <= FAR):
        row = int(np.argmin(np.all(np.abs(table) <= FAR, axis=1))) + 2
        raise ProblemFileError(name, f"line {row}", "not valid", f"finite numbers up to {FAR:g} m")
    return table[:, :3], table[:, 3:]


def _below(lines: list[str], columns: Sequence[str], marked: tuple[str | None, str], *, name: str) -> Array:
    """Numbers (rows, len(columns)) below the header, in which each column must occur once."""
    header = header_cells(lines[0].split(marked[0]), name=name, line=1)
    missing = [column for column in columns if header.count(column) != 1]
    if missing:
        raise ProblemFileError(name, f"line 1, column {missing[0]}", shown(lines[0], 60), "once " + ", ".join(columns))
    return _numbers(lines[1:], header, columns, marked, name=name, first=2)


def _numbers(
    rows: list[str], header: list[str], wanted: Sequence[str], marked: tuple[str | None, str], *, name: str, first: int
) -> Array:
    """Numbers (rows, columns), with NaN for empty cells; `first` is the line number of the first row."""
    lost, (mark, point) = dict.fromkeys(wanted, MISSING), marked
    table = numbers_below(rows, header, wanted, {}, name=name, first=first, separator=mark, point=point, missing=lost)
    if len(table) < 3:
        raise ProblemFileError(name, "rows", len(table), "at least 3 rows of numbers")
    return table
