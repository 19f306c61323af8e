"""Tables of samples under a header that names each column with its unit: CSV, in whichever country it was written."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Recording
from rehab_opt.text_file import FARTHEST, LATEST, finite_number, header_cells, shown, text_lines, times

__all__ = [
    "ANGLE",
    "COUNTS",
    "FORCE",
    "LENGTH",
    "SEPARATORS",
    "TIME",
    "UNITS",
    "canonical_name",
    "check_once",
    "marks",
    "numbers_below",
    "read_csv",
    "unit_of",
]

Array = NDArray[np.float64]


TIME = MappingProxyType({"s": 1.0, "ms": 1e-3})
LENGTH = MappingProxyType({"m": 1.0, "cm": 1e-2, "mm": 1e-3})
ANGLE = MappingProxyType({"rad": 1.0, "deg": math.pi / 180})
FORCE = MappingProxyType({"N": 1.0})
UNITS: Mapping[str, float] = MappingProxyType({**TIME, **LENGTH, **ANGLE, **FORCE})
COUNTS = "counts"
"""The unit of a column of raw counts, whose header names none."""
SPELLINGS = {"sec": "s", "second": "s", "seconds": "s", "msec": "ms", "meter": "m", "metre": "m", "°": "deg",
             "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad"}  # fmt: skip
HAND = ("t", "time", "x", "y", "z", "fx", "fy", "fz")
"""Names that are known in capitals, too."""
LONGEST = 200
NAME = re.compile(r"[^\W\d][\w .\[\]()/°-]{0,60}")
_WITH_UNIT = re.compile(r"([^\[\]()/]+)(?:\[([^\[\]()/]+)\]|\(([^\[\]()/]+)\)|/([^\[\]()/]+))")


def canonical_name(cell: str) -> str:
    """`name_unit` of a header's cell; the cell itself where it names no unit that is known."""
    cell = cell.strip().strip('"').strip()
    if len(cell) > LONGEST:
        return cell
    found = _WITH_UNIT.fullmatch(cell)
    if found is None:
        name, _, unit = cell.rpartition("_")
    else:
        name, unit = found[1].strip(), next(group for group in found.groups()[1:] if group is not None).strip()
    name = name.lower() if name.lower() in HAND else name
    unit = SPELLINGS.get(unit.lower(), unit)
    if name and unit in UNITS:
        return f"{name}_{unit}"
    return cell.lower() if cell.lower() in HAND else cell


def unit_of(column: str) -> str:
    """The unit that a canonical name ends in; `COUNTS` for one of the hand's that has none."""
    return COUNTS if column in HAND else column.rpartition("_")[2]


SEPARATORS: Mapping[str, str] = {"comma": ",", "semicolon": ";", "tab": "\t"}
STRONGEST = 1e4
"""[N] More is no force of a hand but another unit."""


def read_csv(
    path: Path,
    *,
    name: str,
    columns: Sequence[str] | None = None,
    separator: str = "comma",
    decimal: str = "point",
    count_mm: float | None = None,
    tick_ms: float | None = None,
) -> Recording:
    """Samples, separated by `separator`, under a header such as `t_s,x_m,y_m`, `t [s];x [mm];y [mm]` or `t/s,x/m,y/m`.

    Time is `t` or `time` (s, ms), positions `x`, `y` and optionally `z` (m, cm, mm), every column in deg or rad a
    joint, `fx`, `fy` (and `fz`) in N the force on the hand; others are left unread, with a note.

    Parameters
    ----------
    columns : the headers of x, y (and z), if they are named otherwise.
    separator : a key of `SEPARATORS`.
    decimal : "point" or "comma".
    count_mm, tick_ms : lengths and times in headers without a unit are counts of so many mm, and of so many ms.

    Raises
    ------
    ProblemFileError : a missing or doubled column, a row of the wrong length, a cell that is not a finite number.
    """
    lines = text_lines(path, name)
    mark, point = marks(lines[0], separator, decimal, name=name)
    written = [cell.strip('"').strip() for cell in header_cells(lines[0].split(mark), name=name, line=1)]
    if len(written) > 1 and not written[-1]:
        written.pop()  # a separator at the end of each line
    header = [canonical_name(cell) for cell in written]
    if re.fullmatch(r"[-+]?[.,]?\d.*", header[0]):
        raise ProblemFileError(name, "line 1", shown(lines[0]), "a header with units, such as t_s,x_m,y_m")
    check_once(header, name, line=1)
    time_column = _column(header, ("t", "time"), TIME, name, counts=tick_ms is not None)
    if columns is None:
        columns = [_column(header, (axis,), LENGTH, name, counts=count_mm is not None) for axis in ("x", "y")]
        heights = [f"z_{unit}" for unit in LENGTH] + (["z"] if count_mm is not None else [])
        columns += [cell for cell in heights if cell in header][:1]
    else:
        columns = _named(columns, header, written, name)
    factors = {**UNITS, COUNTS: 1e-3 * (count_mm or 0.0)}
    for column in columns:
        if unit_of(column) not in LENGTH and not (column in ("x", "y", "z") and count_mm is not None):
            endings = ", ".join(f"_{unit}" for unit in LENGTH)
            raise ProblemFileError(name, "recording.columns", column, f"a length: a name ending in {endings}")
    angles = [cell for cell in header if unit_of(cell) in ANGLE]
    forces = [cell for cell in ("fx_N", "fy_N", "fz_N") if cell in header]
    if forces and forces[:2] != ["fx_N", "fy_N"]:
        raise ProblemFileError(name, "line 1", forces[0], "fx_N and fy_N together")
    scale_of = {column: factors[unit_of(column)] for column in (*columns, *angles, *forces)}
    scale_of[time_column] = 1e-3 * (tick_ms or 0.0) if unit_of(time_column) == COUNTS else TIME[unit_of(time_column)]
    most = {column: FARTHEST / scale_of[column] for column in columns} | {time_column: LATEST / scale_of[time_column]}
    most |= dict.fromkeys(forces, STRONGEST)
    wanted = [time_column, *columns, *angles, *forces]
    cells = numbers_below(lines[1:], header, wanted, most, name=name, first=2, separator=mark, point=point)
    values = {column: numbers * scale_of[column] for column, numbers in zip(wanted, cells.T, strict=True)}
    unread = ", ".join(cell for cell, known in zip(written, header, strict=True) if known not in values)
    return Recording(
        file=name,
        time=values[time_column],
        points=np.column_stack([values[column] for column in columns]),
        joints={column.rpartition("_")[0]: values[column] for column in angles},
        forces=np.column_stack([values[column] for column in forces]) if forces else np.empty((len(cells), 0)),
        notes=(f"columns not read: {shown(unread, 200)}",) if unread else (),
    )


def numbers_below(
    rows: Sequence[str],
    header: Sequence[str],
    wanted: Sequence[str],
    most: Mapping[str, float],
    *,
    name: str,
    first: int,
    separator: str | None,
    missing: Mapping[str, Collection[str]] = MappingProxyType({}),
    point: str = ".",
) -> Array:
    """(rows, len(wanted)) numbers of the wanted columns; `first` is the first row's line, counted from 1.

    `most` bounds the size of the numbers of some columns; `missing` are cells of some, in small letters, that stand for
    no number, which is NaN; `point` stands before decimals.

    Raises
    ------
    ProblemFileError : no rows, a row of the wrong length, a cell that is not a finite number.
    """
    place_of = {column: place for place, column in enumerate(header)}
    places = [place_of[column] for column in wanted]
    numbers = []
    for number, text in enumerate(rows, start=first):
        row = text.split(separator)
        if len(row) == len(header) + 1 and not row[-1].strip():
            row.pop()
        if len(row) != len(header):
            expected = f"{len(header)}, as in the header"
            if separator == "," and len(row) > len(header):
                expected += " (decimal commas? then other separators, and recording.decimal = 'comma')"
            raise ProblemFileError(name, f"line {number}", f"{len(row)} cells", expected)
        if '"' in text:
            row = [cell.strip().strip('"') for cell in row]
        numbers.append(
            [
                math.nan
                if missing and row[place].strip().lower() in missing.get(column, ())
                else finite_number(
                    row[place], name=name, line=number, column=column, most=most.get(column, math.inf), point=point
                )
                for place, column in zip(places, wanted, strict=True)
            ]
        )
    if not numbers:
        raise ProblemFileError(name, f"line {first}", "no samples", "rows of numbers below the header")
    return np.array(numbers)


def check_once(header: Sequence[str], name: str, *, line: int) -> None:
    """Refuse a header with a column twice, or without a name.

    Raises
    ------
    ProblemFileError : it has.
    """
    seen: set[str] = set()
    for cell in header:
        if cell in seen or not cell:
            raise ProblemFileError(name, f"line {line}", shown(cell), "columns each with a name of its own")
        seen.add(cell)


def marks(line: str, separator: str, decimal: str, *, name: str) -> tuple[str, str]:
    """What stands between the cells of a table, and before decimals, as `read_csv` names them; `line` is the first.

    Raises
    ------
    ProblemFileError : commas for both; a line that has another separator, which is named.
    """
    own = SEPARATORS[separator]
    if separator == decimal:
        expected = "'semicolon' or 'tab', since the decimals are commas"
        raise ProblemFileError(name, "recording.separator", separator, expected)
    for other, mark in SEPARATORS.items():
        if mark in line and (own not in line or own + mark == ",;"):  # commas may be of decimals
            expected = f"'{other}', which line 1 has {times(line.count(mark))}"
            raise ProblemFileError(name, "recording.separator", separator, expected)
    return own, "," if decimal == "comma" else "."


def _column(header: Sequence[str], names: Sequence[str], units: Mapping[str, float], file: str, *, counts: bool) -> str:
    accepted = [f"{name}_{unit}" for name in names for unit in units] + (list(names) if counts else [])
    found = [cell for cell in header if cell in accepted]
    if len(found) != 1:
        # What is no header, as of a file that was named by mistake, is not quoted: it may be anything.
        header_like = len(header) > 1 and all(NAME.fullmatch(cell) for cell in header)
        among = shown(", ".join(header), 60) if header_like else f"{len(header)}, which are no header"
        problem = f"columns {' and '.join(found)}" if found else f"no such column among {among}"
        bare = [cell for cell in header if cell in names]
        expected = f"one of {', '.join(accepted)}"
        if bare and not found:
            key = "recording.tick_ms" if "t" in names else "recording.count_mm"
            expected += f" (or raw counts, and what one is: {key})"
        raise ProblemFileError(file, f"line 1, column {names[0]}", problem, expected)
    return found[0]


def _named(columns: Sequence[str], header: Sequence[str], written: Sequence[str], name: str) -> list[str]:
    """Canonical names of the columns that a user named, as the file writes them or in canonical form."""
    known = {**dict(zip(written, header, strict=True)), **{cell: cell for cell in header}}
    for column in columns:
        if column not in known:
            expected = f"columns of {name}: {shown(', '.join(written), 120)}"
            raise ProblemFileError(name, "recording.columns", column, expected)
    return [known[column] for column in columns]
