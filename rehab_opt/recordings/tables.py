"""Read tables of samples (CSV) with a header of names and units, with any usual separator and decimal sign."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Samples
from rehab_opt.recordings.units import (
    ANGLE,
    COUNTS,
    KINDS,
    LENGTH,
    RATES,
    TIME,
    UNITS,
    Reading,
    each_once,
    known_unit,
    place_of,
)  # fmt: skip
from rehab_opt.text_file import LATEST, brief, finite_number, header_cells, shown, text_lines, times

__all__ = ["MISSING", "SEPARATORS", "canonical_name", "check_once", "marks", "numbers_below", "read_csv", "unit_of"]

Array = NDArray[np.float64]

ALONE = Reading()
"""Default settings."""
COMMENT = re.compile(r"\s*(#|sep=)")
"""Pattern of the beginning of a line above the header: a comment, or the separator for a spreadsheet."""
NUMERIC = re.compile(r"[-+]?[.,]?\d")
"""Pattern of the beginning of a numeric cell."""

TIMES = (("t", "time"), ("timestamp", "timestamps", "time stamp", "time_stamp", "elapsed"))
"""Names of the column of times; names of the second group count only if there is none of the first group."""
HAND = (*TIMES[0], *TIMES[1], "x", "y", "z", "fx", "fy", "fz")
"""Names of columns that may also be written in capitals."""
MISSING = frozenset({
    "", "nan", "na", "n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "#n/a",
    "inf", "+inf", "-inf", "infinity", "-infinity", "1.#inf", "-1.#inf", "<na>", "nat", ".", "-", "--",
    "#num!", "#value!", "#div/0!", "#null!", "#ref!",
})  # fmt: skip
"""Cells, in lower case, that stand for a missing value."""
ROWS = "(rows)"
"""Name for an unnamed first column, which has the numbers of the rows."""
LONGEST = 200
NAME = re.compile(r"[^\W\d][\w .\[\]()/°-]{0,60}")
_WITH_UNIT = re.compile(r"([^\[\]()/]+)(?:\[([^\[\]()/]+)\]|\(([^\[\]()/]+)\)|/([^\[\]()/]+))")


def canonical_name(cell: str) -> str:
    """Canonical name `name_unit` of a header's cell; the cell itself if it has no known unit."""
    cell = cell.strip().strip('"').strip()
    if len(cell) > LONGEST:
        return cell
    found = _WITH_UNIT.fullmatch(cell)
    if found is None:
        name, _, unit = cell.rpartition("_")
    else:
        name, unit = found[1].strip(), next(group for group in found.groups()[1:] if group is not None).strip()
    name = name.lower() if name.lower() in HAND else name
    unit = known_unit(unit)
    if name and unit in UNITS:
        return f"{name}_{unit}"
    return cell.lower() if cell.lower() in HAND else cell


def unit_of(column: str) -> str:
    """Unit at the end of a canonical name; `COUNTS` for a name without a unit."""
    name, _, unit = column.rpartition("_")
    return unit if name and unit in UNITS else COUNTS


SEPARATORS: Mapping[str, str | None] = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": None}
"""Separators of cells by name; None stands for any number of blanks."""
STRONGEST = 1e4
"""Largest force [N]; a larger value is probably in another unit."""


def read_csv(path: Path, *, name: str, how: Reading = ALONE) -> Samples:
    """Samples of a table with a header such as `t_s,x_m,y_m`, `t [s];x [mm];y [mm]` or `t/s,x/m,y/m`.

    The column of times has a name of `TIMES`. Columns `x`, `y` and optionally `z` are positions, columns in deg or rad
    are joint angles, and `fx_N`, `fy_N` and optionally `fz_N` are the force on the hand. Other columns are ignored with
    a note. The header may begin with `#`; units may be in a separate line below the header. If the user numbers the
    columns and the first line has numbers, the table has no header.

    Raises
    ------
    ProblemFileError : a column is missing or repeated, a row has the wrong length, or a cell is not a number.
    """
    lines = text_lines(path, name)
    top = next((i for i, line in enumerate(lines) if not COMMENT.match(line)), len(lines))
    if top and (top == len(lines) or NUMERIC.match(lines[top].strip())):
        top -= 1
    mark, point = marks(lines[top].strip("# "), how.separator, how.decimal, name=name)
    written = [c.strip('"').strip() for c in header_cells(lines[top].lstrip("# ").split(mark), name=name, line=top + 1)]
    if len(written) > 1 and not written[-1]:
        written.pop()  # a separator at the end of each line
    counted = written in ([str(i + first) for i in range(len(written))] for first in (0, 1))  # as pandas names columns
    headless = all(NUMERIC.match(cell) for cell in written) and how.columns is not None and how.time_column is not None
    headless |= how.rate_hz is not None and how.columns is not None and bool(NUMERIC.match(written[0]))
    if headless and not counted:
        written, top = [str(number) for number in range(1, len(written) + 1)], top - 1
    elif NUMERIC.match(written[0]) and not (counted and headless):
        expected = "a header with units, such as t_s,x_m,y_m (or recording.columns and time_column as numbers)"
        raise ProblemFileError(name, f"line {top + 1}", shown(lines[top]), expected)
    written[0] = written[0] or ROWS
    below = lines[top + 1].split(mark) if top + 1 < len(lines) else []
    if len(below) == len(written) + 1 and below[0] in ('"1"', "1" if mark is None else ""):  # as R names rows
        written.insert(0, ROWS)
    units = _units(below) if len(_units(below)) == len(written) else [""] * len(written)
    top += any(units)
    header = [canonical_name(f"{cell} [{unit}]" if unit else cell) for cell, unit in zip(written, units, strict=True)]
    check_once(header, name, line=top + 1)
    kinds = {"time": _times(header, written, how, name), "length": _hand(header, written, how, name)}
    kinds["angle"] = [
        cell
        for cell in header
        if unit_of(cell) in ANGLE and cell not in kinds["length"] and not RATES.search(cell.rpartition("_")[0])
    ]
    scale_of = {cell: _scale(kind, cell, how, name) for kind, cells in kinds.items() for cell in cells}
    forces = [cell for cell in ("fx_N", "fy_N", "fz_N") if cell in header]
    if forces and forces[:2] != ["fx_N", "fy_N"]:
        raise ProblemFileError(name, f"line {top + 1}", forces[0], "fx_N and fy_N together")
    most = {cell: LATEST / scale_of[cell] for cell in kinds["time"]} | dict.fromkeys(forces, STRONGEST)
    wanted = [*kinds["time"], *kinds["length"], *kinds["angle"], *forces]
    cells = numbers_below(
        lines[top + 1 :], header, wanted, most, name=name, first=top + 2, separator=mark, point=point,
        missing=dict.fromkeys(wanted[len(kinds["time"]) :], MISSING),
    )  # fmt: skip
    values = {column: scale_of.get(column, 1.0) * numbers for column, numbers in zip(wanted, cells.T, strict=True)}
    trials: tuple[tuple[str, int, int], ...] = ()
    if how.trials is not None:
        place = _asked(how.trials, header, written, "recording.trials", name)
        trials = _trials([line.split(mark)[header.index(place)].strip(' "') for line in lines[top + 1 :]])
        wanted.append(place)
    unread = [cell for cell, known in zip(written, header, strict=True) if known not in wanted and cell != ROWS]
    return Samples(
        values[kinds["time"][0]] if kinds["time"] else np.zeros(len(cells)),
        np.column_stack([values[column] for column in kinds["length"]])
        if kinds["length"]
        else np.empty((len(cells), 0)),
        {column.rpartition("_")[0]: values[column] for column in kinds["angle"]},
        np.column_stack([values[column] for column in forces]) if forces else np.empty((len(cells), 0)),
        (f"columns not read: {shown(', '.join(unread), 200)}",) if unread else (),
        trials=trials,
    )


def _units(cells: Sequence[str]) -> list[str]:
    """Units in the line below a header, "" for a column without a unit; empty if the line does not state units."""
    units = [known_unit(cell.strip(' "[]()')) for cell in cells]
    return units if all(unit in UNITS or not unit for unit in units) else []


def _trials(labels: Sequence[str]) -> tuple[tuple[str, int, int], ...]:
    """Trials (name, first row, last row): consecutive samples with the same label; a repeated label gets a number."""
    ends = [i for i, (label, after) in enumerate(pairwise([*labels, None])) if label != after]
    firsts = [0, *(end + 1 for end in ends)]
    parts, seen = [], Counter[str]()
    for label, first, last in ((labels[a], a, b) for a, b in zip(firsts, ends, strict=False)):
        if label.lower() not in MISSING:
            seen[label] += 1
            parts.append((f"{label} ({seen[label]})" if seen[label] > 1 else label, first, last))
    return tuple(parts)


def _scale(kind: str, cell: str, how: Reading, name: str) -> float:
    """Factor from a column's unit to SI units [m, rad, s]."""
    unit = unit_of(cell)
    if unit in KINDS[kind] or (unit == COUNTS and how.counted(kind) is not None):
        return how.factor(kind, "" if unit == COUNTS else unit, name=name, where=cell)
    key = {"length": "recording.columns", "time": "recording.time_column"}.get(kind, kind)
    expected = f"a {kind}: a name ending in {', '.join(f'_{each}' for each in KINDS[kind])}, or recording.units"
    raise ProblemFileError(name, key, cell, expected)


def _times(header: Sequence[str], written: Sequence[str], how: Reading, name: str) -> list[str]:
    """Name of the column of times, in a list; empty if the user states a sampling rate."""
    if how.rate_hz is not None:
        return []
    if how.time_column is not None:
        return [_asked(how.time_column, header, written, "recording.time_column", name)]
    bare = how.counted("time") is not None
    sooner, later = ({cell for cell in header if cell in names or cell.rpartition("_")[0] in names} for names in TIMES)
    return [_column(header, TIMES[1 if later and not sooner else 0], TIME, name, bare=bare)]


def _hand(header: Sequence[str], written: Sequence[str], how: Reading, name: str) -> list[str]:
    """Names of the columns of x, y and, if present, z; empty for a table with joint angles but no positions."""
    if how.columns is not None:
        return each_once([_asked(each, header, written, "recording.columns", name) for each in how.columns], how, name)
    if any(unit_of(cell) in ANGLE for cell in header) and not {*"xyz"} & {
        name for cell in header for name in (cell, cell.rpartition("_")[0])
    }:
        return []
    bare = how.counted("length") is not None
    columns = [_column(header, (axis,), LENGTH, name, bare=bare) for axis in ("x", "y")]
    high = {"z", *(f"z_{unit}" for unit in LENGTH)} & {*header}
    return [*columns, _column(header, ("z",), LENGTH, name, bare=bare)] if high else columns


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
    called: Mapping[str, str] = MappingProxyType({}),
) -> Array:
    """Numbers (rows, columns) in the `wanted` columns of a table.

    Parameters
    ----------
    rows : lines below the header. header : names of all columns.
    wanted : names of the columns to read. most : largest magnitude in a column.
    name : name of the file. first : line number of the first row, from 1.
    separator : separator of the cells, None for blanks. missing : for each column, cells in lower case that become NaN.
    point : decimal sign. called : names of columns in error messages, if they differ.

    Raises
    ------
    ProblemFileError : there are no rows, a row has the wrong length, or a cell is not a finite number.
    """
    place_of = {column: place for place, column in enumerate(header)}
    places = [place_of[column] for column in wanted]
    numbers = []

    def number_in(cell: str, column: str, line: int) -> float:
        if missing and cell.strip().lower() in missing.get(column, ()):
            return math.nan
        said, bound = called.get(column, column), most.get(column, math.inf)
        return finite_number(cell, name=name, line=line, column=said, most=bound, point=point)

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
        numbers.append([number_in(row[place], column, number) for place, column in zip(places, wanted, strict=True)])
    if not numbers:
        raise ProblemFileError(name, f"line {first}", "no samples", "rows of numbers below the header")
    return np.array(numbers)


def check_once(header: Sequence[str], name: str, *, line: int) -> None:
    """Check that each column has a name of its own.

    Raises
    ------
    ProblemFileError : a name is repeated or empty.
    """
    seen: set[str] = set()
    for cell in header:
        if cell in seen or not cell:
            raise ProblemFileError(name, f"line {line}", shown(cell), "columns each with a name of its own")
        seen.add(cell)


def marks(line: str, separator: str, decimal: str, *, name: str) -> tuple[str | None, str]:
    """Separator and decimal sign of a table, checked against the table's first line.

    Raises
    ------
    ProblemFileError : both are commas, or the line has another separator, which the message names.
    """
    own = SEPARATORS[separator]
    if own is None:
        return None, "," if decimal == "comma" else "."
    if separator == decimal:
        expected = "'semicolon' or 'tab', since the decimals are commas"
        raise ProblemFileError(name, "recording.separator", separator, expected)
    for other, mark in SEPARATORS.items():
        if mark is None:
            if own not in line and sum(unit_of(canonical_name(cell)) in UNITS for cell in line.split()) > 2:
                raise ProblemFileError(name, "recording.separator", separator, f"'{other}', as in line 1")
        elif mark in line and (own not in line or own + mark == ",;"):  # commas may be of decimals
            expected = f"'{other}', which line 1 has {times(line.count(mark))}"
            raise ProblemFileError(name, "recording.separator", separator, expected)
    return own, "," if decimal == "comma" else "."


def _column(header: Sequence[str], names: Sequence[str], units: Mapping[str, float], file: str, *, bare: bool) -> str:
    accepted = [f"{name}_{unit}" for name in names for unit in units] + (list(names) if bare else [])
    found = [cell for cell in header if cell in accepted]
    if len(found) != 1:
        # The line is quoted only if it looks like a header: a file named by mistake may have private content.
        header_like = len(header) > 1 and all(NAME.fullmatch(cell) for cell in header)
        among = shown(", ".join(header), 60) if header_like else f"{len(header)}, which are no header"
        problem = f"columns {' and '.join(found)}" if found else f"no such column among {among}"
        expected = f"one of {', '.join(accepted[:8])}"
        times = "t" in names or "timestamp" in names
        if [cell for cell in header if cell in names] and not found:
            key = "recording.tick_ms" if times else "recording.count_mm"
            expected += f" (or its unit in recording.units; of raw counts what one is: {key})"
        elif not found:
            expected += f" (or {'recording.time_column or recording.rate_hz' if times else 'recording.columns'})"
        raise ProblemFileError(file, f"line 1, column {names[0]}", problem, expected)
    return found[0]


def _asked(column: str | int, header: Sequence[str], written: Sequence[str], key: str, name: str) -> str:
    """Canonical name of a column that the user gives by its name in the file, its canonical name or its number."""
    named = column in header and not isinstance(column, int)
    place = header.index(str(column)) if named else place_of(column, written)
    if place is None:
        expected = f"columns of {name}: {shown(', '.join(written), 120)}"
        raise ProblemFileError(name, key, brief(column), expected)
    return header[place]
