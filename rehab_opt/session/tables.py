"""Tables of samples: CSV whose header names each column with its unit, and OpenSim's motion files (.mot)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.file_limits import header_cells
from rehab_opt.session.recording import Recording
from rehab_opt.session.text_lines import FARTHEST, LATEST, brief, finite_number, text_lines
from rehab_opt.text_file import shown

__all__ = ["read_csv", "read_mot"]

Array = NDArray[np.float64]

TIME = {"s": 1.0, "ms": 1e-3}
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ANGLE = {"rad": 1.0, "deg": math.pi / 180}
FORCE = {"N": 1.0}
UNITS = {**TIME, **LENGTH, **ANGLE, **FORCE}
STRONGEST = 1e4
"""[N] More is no force of a hand but another unit."""


def read_csv(path: Path, *, name: str, columns: Sequence[str] | None = None) -> Recording:
    """Comma separated samples under a header such as `t_s,x_m,y_m`.

    Time is `t` or `time` (`_s`, `_ms`), positions `x`, `y` and optionally `z` (`_m`, `_cm`, `_mm`), every column in
    `_deg` or `_rad` a joint, `fx_N`, `fy_N` (and `fz_N`) the force on the hand; others are left unread, with a note.

    Parameters
    ----------
    columns : the headers of x, y (and z), if they are named otherwise.

    Raises
    ------
    ProblemFileError : a missing or doubled column, a row of the wrong length, a cell that is not a finite number.
    """
    lines = text_lines(path, name)
    header = header_cells(lines[0].split(","), name=name, line=1)
    if _numeric(header[0]):
        raise ProblemFileError(name, "line 1", shown(lines[0]), "a header with units, such as t_s,x_m,y_m")
    _check_once(header, name, line=1)
    time_column = _column(header, ("t", "time"), TIME, name)
    if columns is None:
        columns = [_column(header, (axis,), LENGTH, name) for axis in ("x", "y")]
        columns += [cell for cell in (f"z_{unit}" for unit in LENGTH) if cell in header][:1]
    _check_named(columns, header, name)
    for column in columns:
        if _unit(column) not in LENGTH:
            raise ProblemFileError(name, "recording.columns", column, f"a length: a name ending in {_endings(LENGTH)}")
    angles = [cell for cell in header if _unit(cell) in ANGLE]
    forces = [cell for cell in ("fx_N", "fy_N", "fz_N") if cell in header]
    if forces and forces[:2] != ["fx_N", "fy_N"]:
        raise ProblemFileError(name, "line 1", forces[0], "fx_N and fy_N together")
    wanted = [time_column, *columns, *angles, *forces]
    most = {time_column: LATEST / UNITS[_unit(time_column)]}
    most |= {column: FARTHEST / UNITS[_unit(column)] for column in columns}
    most |= dict.fromkeys(forces, STRONGEST)
    cells = _cells(lines, header, wanted, most, name=name, first=2, separator=",")
    values = {column: numbers * UNITS[_unit(column)] for column, numbers in zip(wanted, cells.T, strict=True)}
    unread = ", ".join(cell for cell in header if cell not in values)
    return Recording(
        file=name,
        time=values[time_column],
        points=np.column_stack([values[column] for column in columns]),
        joints={column.rpartition("_")[0]: values[column] for column in angles},
        forces=np.column_stack([values[column] for column in forces]) if forces else np.empty((len(cells), 0)),
        notes=(f"columns not read: {shown(unread, 200)}",) if unread else (),
    )


def read_mot(path: Path, *, name: str, columns: Sequence[str] | None = None) -> Recording:
    """OpenSim motion file, separated by commas, tabs or blanks: joint angles, and lengths in metres.

    Columns that end in `tx`, `ty`, `tz` or `transX`, `transY`, `transZ` are lengths [m]; all others are angles, in
    degrees if the header says `inDegrees=yes`.

    Parameters
    ----------
    columns : the columns that hold x, y (and z) of the hand; none by default.

    Raises
    ------
    ProblemFileError : no `endheader`, no `inDegrees`, a missing column, a cell that is not a finite number. A row
        count in the header that does not hold is a note.
    """
    lines = text_lines(path, name)
    ends = [i for i, line in enumerate(lines) if line.strip(", \t").lower() == "endheader"]
    if not ends or ends[0] + 1 >= len(lines):
        raise ProblemFileError(name, "header", "no endheader line", "a line endheader, and column names below it")
    facts = dict(line.strip(", \t").split("=", 1) for line in lines[: ends[0]] if "=" in line)
    facts = {key.strip().lower(): value.strip().lower() for key, value in facts.items()}
    if facts.get("indegrees") not in ("yes", "no"):
        raise ProblemFileError(name, "header inDegrees", brief(facts.get("indegrees")), "yes or no")
    top = ends[0] + 1
    separator = "," if "," in lines[top] else None
    header = header_cells(lines[top].split(separator), name=name, line=top + 1)
    _check_once(header, name, line=top + 1)
    columns = list(columns or ())
    _check_present("time", header, name, line=top + 1)
    _check_named(columns, header, name)
    lengths = {cell for cell in header if re.search(r"(^|_)t[xyz]$|trans[XYZ]$", cell)}
    most = {"time": LATEST, **dict.fromkeys(lengths, FARTHEST)}
    cells = _cells(lines, header, header, most, name=name, first=top + 2, separator=separator)
    by_name = dict(zip(header, cells.T, strict=True))
    unit = ANGLE["deg"] if facts["indegrees"] == "yes" else 1.0
    for column in columns:
        if column not in lengths:
            raise ProblemFileError(name, "recording.columns", column, "a length: a name ending in tx..tz or transX..Z")
    stated = facts.get("nrows", str(len(cells)))
    notes = [] if stated == str(len(cells)) else [f"its header states {stated} rows, {len(cells)} are there"]
    return Recording(
        file=name,
        time=by_name["time"].copy(),
        points=np.column_stack([by_name[column] for column in columns]) if columns else np.empty((len(cells), 0)),
        joints={cell: unit * by_name[cell] for cell in header if cell != "time" and cell not in lengths},
        notes=tuple(notes),
    )


def _cells(
    lines: list[str],
    header: list[str],
    wanted: list[str],
    most: dict[str, float],
    *,
    name: str,
    first: int,
    separator: str | None,
) -> Array:
    """(rows, len(wanted)) numbers of the wanted columns; `first` is the first row's line, counted from 1.

    `most` bounds the size of the numbers of some columns.
    """
    place_of = {column: place for place, column in enumerate(header)}
    places = [place_of[column] for column in wanted]
    rows = []
    for number, text in enumerate(lines[first - 1 :], start=first):
        row = text.split(separator)
        if len(row) != len(header):
            raise ProblemFileError(name, f"line {number}", f"{len(row)} cells", f"{len(header)}, as in the header")
        rows.append(
            [
                finite_number(row[place], name=name, line=number, column=column, most=most.get(column, math.inf))
                for place, column in zip(places, wanted, strict=True)
            ]
        )
    if not rows:
        raise ProblemFileError(name, f"line {first}", "no samples", "rows of numbers below the header")
    return np.array(rows)


def _column(header: list[str], names: Sequence[str], units: dict[str, float], file: str) -> str:
    accepted = [f"{name}_{unit}" for name in names for unit in units]
    found = [cell for cell in header if cell in accepted]
    if len(found) != 1:
        problem = f"columns {' and '.join(found)}" if found else f"no such column among {shown(', '.join(header), 60)}"
        raise ProblemFileError(file, f"line 1, column {names[0]}", problem, f"one of {', '.join(accepted)}")
    return found[0]


def _unit(column: str) -> str:
    return column.rpartition("_")[2]


def _endings(units: dict[str, float]) -> str:
    return ", ".join(f"_{unit}" for unit in units)


def _numeric(cell: str) -> bool:
    return re.fullmatch(r"[-+]?\.?\d.*", cell) is not None


def _check_present(column: str, header: list[str], name: str, *, line: int) -> None:
    if column not in header:
        raise ProblemFileError(
            name, f"line {line}, column {column}", "missing", f"one of {shown(', '.join(header), 120)}"
        )


def _check_named(columns: Sequence[str], header: list[str], name: str) -> None:
    for column in columns:
        if column not in header:
            raise ProblemFileError(
                name, "recording.columns", column, f"columns of {name}: {shown(', '.join(header), 120)}"
            )


def _check_once(header: list[str], name: str, *, line: int) -> None:
    seen: set[str] = set()
    for cell in header:
        if cell in seen or not cell:
            raise ProblemFileError(name, f"line {line}", shown(cell), "columns each with a name of its own")
        seen.add(cell)
