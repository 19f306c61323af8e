"""Motion-capture markers (.trc): frames of named markers in space, separated by tabs or commas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Recording
from rehab_opt.text_file import FARTHEST, LATEST, brief, finite_number, header_cells, shown, text_lines

__all__ = ["LENGTH", "marker_place", "read_trc", "seen_marker"]

LENGTH = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
LONGEST_GAP = 0.2  # [s] a hidden marker is bridged by a straight line up to here; a reach is over in about a second
FIRST_ROW = 6  # below path, fact names, facts, marker names and axes (a sixth, empty line is usual and skipped)


def read_trc(path: Path, *, name: str, marker: str | None) -> Recording:
    """Path of one marker, (N, 3) [m] in the laboratory's frame.

    Frames in which the marker was not seen (empty cells or NaN) are left out and counted in the notes.

    Raises
    ------
    ProblemFileError : no such marker, an unknown length unit, a row of the wrong length, a cell that is no number, a
        marker hidden for more than 0.2 s. A frame count in the header that does not hold is a note.
    """
    lines = text_lines(path, name)
    if len(lines) < FIRST_ROW or not lines[0].startswith("PathFileType"):
        raise ProblemFileError(name, "line 1", shown(lines[0]), "a .trc header: PathFileType, and four lines more")
    separator = "\t" if "\t" in lines[3] else ","
    facts = dict(zip(lines[1].split(separator), lines[2].split(separator), strict=False))
    facts = {key.strip(): value.strip() for key, value in facts.items()}
    if facts.get("Units") not in LENGTH:
        raise ProblemFileError(name, "line 3, Units", brief(facts.get("Units")), f"one of {', '.join(LENGTH)}")
    unit = LENGTH[facts["Units"]]
    header = header_cells(lines[3].split(separator), name=name, line=4)
    if header[:2] != ["Frame#", "Time"]:
        raise ProblemFileError(name, "line 4", shown(lines[3]), "Frame#, Time and the names of the markers")
    markers = [cell for cell in header[2:] if cell]
    rows, whole, place = [], 2 + 3 * len(markers), 2 + 3 * marker_place(marker, markers, name)
    if header[2:whole:3] != markers:
        raise ProblemFileError(name, "line 4", shown(lines[3]), "a marker's name in every third cell")
    for number, text in enumerate(lines[FIRST_ROW - 1 :], start=FIRST_ROW):
        row = [cell.strip() for cell in text.split(separator)]
        if not any(row):
            continue
        if len(row) < whole or any(row[whole:]):  # one cell less, and every marker behind it is another's
            expected = f"{whole}: frame, time, and x, y, z of {len(markers)} markers"
            raise ProblemFileError(name, f"line {number}", f"{len(row)} cells", expected)
        time = finite_number(row[1], name=name, line=number, column="Time", most=LATEST)
        cells = row[place : place + 3]
        rows.append([time, *_position(cells, name=name, line=number, marker=str(marker), most=FARTHEST / unit)])
    return seen_marker(np.array(rows).reshape(-1, 4), name, str(marker), unit, facts.get("NumFrames", ""))


def _position(cells: list[str], *, name: str, line: int, marker: str, most: float) -> list[float]:
    if all(cell.lower() in ("", "nan") for cell in cells):
        return [math.nan] * 3
    return [
        finite_number(cell, name=name, line=line, column=f"{marker} {axis}", most=most)
        for cell, axis in zip(cells, "XYZ", strict=True)
    ]


def marker_place(marker: str | None, markers: Sequence[str], name: str) -> int:
    """Place of a marker, named in full, or by what follows the subject in `Subject:MARKER`.

    No such marker, or several: refused, and the markers are named without subjects, who may be people.
    """
    own = [each.rpartition(":")[2] for each in markers]
    names = markers if marker in markers else own
    if names.count(str(marker)) != 1:
        known = f"one of {shown(', '.join(dict.fromkeys(own)), 120)}"
        expected = f"{known}, with its subject (Subject:MARKER)" if marker in own else known
        raise ProblemFileError(name, "recording.marker", marker, expected)
    return names.index(str(marker))


def seen_marker(
    rows: np.ndarray[tuple[int, ...], np.dtype[np.float64]], name: str, marker: str, unit: float, stated: str
) -> Recording:
    """The recording of rows (N, 4) of time [s] and position [unit m], NaN where the marker was hidden.

    Parameters
    ----------
    stated : how many frames the file says it has.

    Raises
    ------
    ProblemFileError : the marker was hidden for more than 0.2 s.
    """
    seen = ~np.isnan(rows[:, 1])
    notes = []
    if stated != str(len(rows)):
        notes.append(f"its header states {stated} frames, {len(rows)} are there")
    if not seen.all():
        notes.append(f"{np.count_nonzero(~seen)} frames without marker {marker} left out")
    time = rows[seen, 0]
    gaps = np.diff(time)
    # a low frame rate is no gap: only what was left out counts
    if not seen.all() and gaps.size and gaps.max() > LONGEST_GAP:
        at = time[int(gaps.argmax())]
        value = f"hidden for {gaps.max():.3g} s from {at:g} s"
        raise ProblemFileError(name, f"marker {marker}", value, f"at most {LONGEST_GAP} s")
    return Recording(file=name, time=time, points=unit * rows[seen, 1:], notes=tuple(notes))
