"""Read motion-capture markers from .trc files, whose cells are separated by tabs or commas."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Samples
from rehab_opt.recordings.tables import MISSING
from rehab_opt.recordings.units import Reading, place_of
from rehab_opt.text_file import LATEST, finite_number, header_cells, number_in, shown, text_lines

__all__ = ["marker_place", "read_trc"]

FIRST_ROW = 6  # line below path, names of facts, facts, names of markers, and axes


def read_trc(path: Path, *, name: str, how: Reading) -> Samples:
    """Path (N, 3) [m] of one marker in the laboratory's frame, NaN where the marker is missing.

    In the file, each name is above the coordinates of its marker, or the names have the order of the coordinates.
    Coordinates after the last name belong to unnamed markers.

    Raises
    ------
    ProblemFileError : the marker is missing, the unit of length is unknown, a row has the wrong length, or a cell is
        not a number.
    """
    lines = text_lines(path, name)
    if len(lines) < FIRST_ROW or not lines[0].startswith("PathFileType"):
        raise ProblemFileError(name, "line 1", shown(lines[0]), "a .trc header: PathFileType, and four lines more")
    separator = "\t" if "\t" in lines[3] else ","
    # Facts and their names are never empty; some programs put two tabs between facts, but one between names.
    facts = dict(zip(*([c.strip() for c in line.split(separator) if c.strip()] for line in lines[1:3]), strict=False))
    if separator not in lines[3]:
        raise ProblemFileError(name, "line 4", shown(lines[3]), "cells separated by tabs or commas")
    second = how.factor("time", "s", name=name, where="line 4, Time")
    unit = how.factor("length", facts.get("Units"), name=name, where="line 3, Units")
    header = header_cells(lines[3].split(separator), name=name, line=4)
    if [cell.lower().rstrip("#") for cell in header[:2]] != ["frame", "time"]:
        raise ProblemFileError(name, "line 4", shown(lines[3]), "Frame#, Time and the names of the markers")
    rows = [
        (number, row)
        for number, row in enumerate(([c.strip() for c in line.split(separator)] for line in lines[FIRST_ROW - 1 :]), 6)
        if any(row)
    ]
    filled = max((max(i for i, cell in enumerate(row) if cell) + 1 for _, row in rows), default=2)
    markers = _markers(header, filled, name)
    whole = 2 + 3 * max(len(markers), math.ceil((filled - 2) / 3))
    place = 2 + 3 * marker_place(how.marker, markers, name, count=(whole - 2) // 3)
    table = []
    for number, row in rows:
        if len(row) < whole or any(row[whole:]):  # a missing cell would shift the coordinates of all later markers
            expected = f"{whole}: frame, time, and x, y, z of {(whole - 2) // 3} markers"
            raise ProblemFileError(name, f"line {number}", f"{len(row)} cells", expected)
        time = finite_number(row[1], name=name, line=number, column="Time", most=LATEST / second)
        cells = [
            math.nan
            if cell.lower() in MISSING
            else finite_number(cell, name=name, line=number, column=f"{how.marker} {axis}")
            for cell, axis in zip(row[place : place + 3], "XYZ", strict=True)
        ]
        table.append([time, *cells])
    stated, rate = number_in(facts.get("NumFrames", "")), number_in(facts.get("DataRate", ""))
    wrong = not math.isnan(stated) and stated != len(table)
    notes = (f"its header states {stated:.0f} frames, {len(table)} are there",) if wrong else ()
    samples = np.array(table).reshape(-1, 4)
    known = rate if 0 < rate < math.inf else None
    return Samples(second * samples[:, 0], unit * samples[:, 1:], notes=notes, rate=known)


def _markers(header: Sequence[str], filled: int, name: str) -> list[str]:
    """Names of the markers in the order of their coordinates, "" for an unnamed marker.

    `filled` is the number of cells up to the last filled cell of any row.
    """
    above = list(header[2::3])
    while above and not above[-1]:
        above.pop()
    named = [cell for cell in header[2:] if cell]
    if [cell for cell in above if cell] == named:
        return above
    if 2 + 3 * len(named) < filled:
        raise ProblemFileError(name, "line 4", f"{len(named)} names", "a marker's name above each x, or one for each")
    return named


def marker_place(
    marker: str | int | None, markers: Sequence[str], name: str, *, count: int, but: Collection[str] = ()
) -> int:
    """Index of a marker by its full name, by its name without the subject, or by its number from 1 to `count`.

    The error message lists markers without subjects, since a subject may be a person's name.

    Raises
    ------
    ProblemFileError : there is no such marker, or several.
    """
    own = [each.rpartition(":")[2] for each in markers]
    names = markers if marker in markers else own
    place = place_of(marker, names, count) if marker else None
    if place is None:
        known = f"one of {shown(', '.join(each for each in dict.fromkeys(own) if each and each not in but), 120)}"
        expected = f"{known}, with its subject (Subject:MARKER)" if marker in own else known
        same = [number for number, each in enumerate(names, start=1) if each == marker]
        if len({markers[number - 1] for number in same}) < len(same):
            expected = f"a name that one marker has, or its number: {' or '.join(map(str, same))}"
        raise ProblemFileError(name, "recording.marker", marker, expected)
    return place
