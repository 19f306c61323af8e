"""Read OpenSim's motion files (.mot) and storage files (.sto)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Samples
from rehab_opt.recordings.tables import MISSING, check_once, numbers_below
from rehab_opt.recordings.units import RATES, Reading, each_once, place_of
from rehab_opt.text_file import LATEST, brief, header_cells, number_in, shown, text_lines

__all__ = ["read_opensim"]

LENGTHS = {".mot": r"(^|[_/])t[xyz]$|trans[XYZ]$", ".sto": r"(^|[_/])t[xyz]$|trans[XYZ]$|_[XYZxyz]$"}
"""Patterns of the names of columns in metres; in a .sto file of body kinematics, these names end in an axis."""
OTHERS = re.compile(
    r"force|moment|torque|dynamics|optimi[sz]ation|activation|excitation|control|reaction|power|length|fiber|tendon|"
    r"pennation|muscle|error|probe|energy|emg|electromyo|point",
    re.IGNORECASE,
)
"""Words in line 1 that mark quantities other than positions and joint angles."""
NO_MOTION = re.compile(
    r"activation|excitation|control|fib(er|re)|tendon|pennation|muscle|force|torque|moment|power|"
    r"reserve|residual|lambda|energy|pressure|emg|(^|_)tau(_|$)|_u$|_udot$|_[fmpv][xyz]$|^/(?!jointset/.*/value$)",
    re.IGNORECASE,
)
"""Pattern of names of columns that are neither positions nor joint angles, such as speeds, forces and muscles."""


def read_opensim(path: Path, *, name: str, how: Reading) -> Samples:
    """Joint angles and positions [m] of an OpenSim file whose cells are separated by commas, tabs or blanks.

    A column is a length [m] if its name ends in `tx`, `ty`, `tz` or `transX`, `transY`, `transZ`; in a .sto file also
    `_X`, `_Y`, `_Z`. In a path such as `/jointset/shoulder/elevation/value`, the coordinate's name counts. Any other
    column is an angle, unless line 1 or its name shows a speed, a force or a muscle. Angles are in degrees if the
    header has `inDegrees=yes`; if neither header nor user state the unit, angles are left out with a note. In a .sto
    file without a title, only paths that end in `/value` are angles, unless the user states the unit of angles.

    Raises
    ------
    ProblemFileError : `endheader` or a column is missing, a chosen column is not a position, or a cell is not a number.
    """
    lines = text_lines(path, name)
    ends = [i for i, line in enumerate(lines) if line.strip(", \t").lower() == "endheader"]
    if not ends or ends[0] + 1 >= len(lines):
        raise ProblemFileError(name, "header", "no endheader line", "a line endheader, and column names below it")
    facts = dict(line.strip(", \t").split("=", 1) for line in lines[: ends[0]] if "=" in line)
    facts = {key.strip().lower(): value.strip().lower() for key, value in facts.items()}
    units = re.search(r"angles are in (degrees|radians)", " ".join(lines[: ends[0]]), re.IGNORECASE)
    if units:
        facts.setdefault("indegrees", "yes" if units[1].lower() == "degrees" else "no")
    title = "" if "=" in lines[0] or not ends[0] else lines[0].strip()
    top = ends[0] + 1
    separator = "," if "," in lines[top] else None
    header = header_cells(lines[top].split(separator), name=name, line=top + 1)
    header[0] = header[0].lower() if header[0].lower() == "time" else header[0]
    check_once(header, name, line=top + 1)
    if "time" not in header:
        expected = f"one of {shown(', '.join(header), 120)}"
        raise ProblemFileError(name, f"line {top + 1}, column time", "missing", expected)
    strange = {cell for cell in header if NO_MOTION.search(cell) or RATES.search(cell)}
    named = LENGTHS[".sto" if path.suffix.lower() == ".sto" else ".mot"]
    lengths = {cell for cell in header if cell not in strange and re.search(named, cell.removesuffix("/value"))}
    columns = [_place(column, header, lengths, strange, title, how, name) for column in how.columns or ()]
    columns = each_once(columns, how, name)
    angles = [cell for cell in header if cell != "time" and cell not in {*lengths, *strange, *columns}]
    if not title and named == LENGTHS[".sto"] and how.stated("angle") is None:
        angles = [cell for cell in angles if cell.endswith("/value")]
    known, note = _angles(facts.get("indegrees"), title, how, needed=not columns, name=name)
    joints = angles if known else []
    wanted = ["time", *columns, *joints]
    metre = how.factor("length", "m", name=name, where="lengths") if lengths or columns else 1.0
    second = how.factor("time", "s", name=name, where="column time")
    most = {"time": LATEST / second}
    missing = dict.fromkeys(wanted[1:], MISSING)
    cells = numbers_below(
        lines[top + 1 :], header, wanted, most, name=name, first=top + 2, separator=separator, missing=missing
    )
    by_name = dict(zip(wanted, cells.T, strict=True))
    stated = number_in(facts.get("nrows", ""))
    notes = [f"its header states {stated:.0f} rows, {len(cells)} are there"] if abs(stated - len(cells)) > 0 else []
    notes += [note] if note and (angles or not columns) else []
    unread = [cell for cell in header if cell not in {"time", *lengths, *angles, *columns}]
    said = "" if title or {*unread} <= strange else " (line 1 has no title that says what they are)"
    notes += [f"columns not read: {shown(', '.join(unread), 200)}{said}"] if unread else []
    points = metre * np.column_stack([by_name[column] for column in columns]) if columns else np.empty((len(cells), 0))
    turn = {"yes": "deg", "no": "rad"}.get(facts.get("indegrees", ""))
    unit = how.factor("angle", turn, name=name, where="header inDegrees") if joints else 1.0
    turned = {cell: unit * by_name[cell] for cell in joints}
    return Samples(second * by_name["time"], points, turned, notes=tuple(notes))


def _place(  # noqa: PLR0917  (a column, and what is known of all of them)
    column: str | int, header: list[str], lengths: set[str], strange: set[str], title: str, how: Reading, name: str
) -> str:
    """Name of the chosen column; raises ProblemFileError if the column is missing or has no positions."""
    place = place_of(column, header)
    if place is None:
        expected = f"columns of {name}: {shown(', '.join(header), 120)}"
        raise ProblemFileError(name, "recording.columns", column, expected)
    if RATES.search(title):
        raise ProblemFileError(name, "recording.columns", column, f"a place; line 1 says {shown(title)}")
    if header[place] not in lengths and (header[place] in strange or how.counted("length") is None):
        expected = "a length: a name ending in tx..tz or transX..Z"
        raise ProblemFileError(name, "recording.columns", column, expected)
    return header[place]


def _angles(said: str | None, title: str, how: Reading, *, needed: bool, name: str) -> tuple[str, str]:
    """Two results: whether angles are in degrees ("yes" or "no"; "" if angles are not read); and a note."""
    stated = {None: "", "deg": "yes", "rad": "no"}[how.stated("angle")]
    if RATES.search(title) or (OTHERS.search(title) and not stated):
        return "", f"its line 1 says {shown(title)}: no angles are read"
    if not stated and (said not in (None, "yes", "no") or (said is None and needed)):
        raise ProblemFileError(name, "header inDegrees", brief(said), "yes or no, or recording.units")
    note = "its header says nothing of inDegrees: angles are not read (recording.units)"
    return stated or said or "", "" if stated or said else note
