"""OpenSim's files of motion (.mot) and of whatever else it stores over time (.sto)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Recording
from rehab_opt.recordings.tables import ANGLE, check_once, numbers_below
from rehab_opt.text_file import FARTHEST, LATEST, brief, header_cells, shown, text_lines

__all__ = ["read_opensim"]

LENGTHS = {".mot": r"(^|_)t[xyz]$|trans[XYZ]$", ".sto": r"(^|_)t[xyz]$|trans[XYZ]$|_[XYZxyz]$"}
"""Names of columns in metres; those of body kinematics in a .sto end in an axis."""


def read_opensim(path: Path, *, name: str, columns: Sequence[str] | None = None) -> Recording:
    """OpenSim motion or storage, separated by commas, tabs or blanks: joint angles, and lengths in metres.

    Columns that end in `tx`, `ty`, `tz` or `transX`, `transY`, `transZ` (of a .sto in `_X`, `_Y`, `_Z` too) are lengths
    [m]; all others are angles, in degrees if the header says `inDegrees=yes`. Of a .sto whose header does not say,
    they are left unread, with a note.

    Parameters
    ----------
    columns : the columns that hold x, y (and z) of the hand; none by default.

    Raises
    ------
    ProblemFileError : no `endheader`, no `inDegrees`, a missing column, a cell that is not a finite number.
    """
    storage = path.suffix.lower() == ".sto"
    lines = text_lines(path, name)
    ends = [i for i, line in enumerate(lines) if line.strip(", \t").lower() == "endheader"]
    if not ends or ends[0] + 1 >= len(lines):
        raise ProblemFileError(name, "header", "no endheader line", "a line endheader, and column names below it")
    facts = dict(line.strip(", \t").split("=", 1) for line in lines[: ends[0]] if "=" in line)
    facts = {key.strip().lower(): value.strip().lower() for key, value in facts.items()}
    told = facts.get("indegrees") in ("yes", "no")
    if not told and not (storage and "indegrees" not in facts):
        raise ProblemFileError(name, "header inDegrees", brief(facts.get("indegrees")), "yes or no")
    top = ends[0] + 1
    separator = "," if "," in lines[top] else None
    header = header_cells(lines[top].split(separator), name=name, line=top + 1)
    check_once(header, name, line=top + 1)
    if "time" not in header:
        expected = f"one of {shown(', '.join(header), 120)}"
        raise ProblemFileError(name, f"line {top + 1}, column time", "missing", expected)
    lengths = {cell for cell in header if re.search(LENGTHS[".sto" if storage else ".mot"], cell)}
    columns = list(columns or ())
    for column in columns:
        if column not in header:
            expected = f"columns of {name}: {shown(', '.join(header), 120)}"
            raise ProblemFileError(name, "recording.columns", column, expected)
        if column not in lengths:
            raise ProblemFileError(name, "recording.columns", column, "a length: a name ending in tx..tz or transX..Z")
    wanted = header if told else ["time", *columns]
    most = {"time": LATEST, **dict.fromkeys(lengths, FARTHEST)}
    cells = numbers_below(lines[top + 1 :], header, wanted, most, name=name, first=top + 2, separator=separator)
    by_name = dict(zip(wanted, cells.T, strict=True))
    unit = ANGLE["deg"] if facts.get("indegrees") == "yes" else 1.0
    stated = facts.get("nrows", str(len(cells)))
    notes = [] if stated == str(len(cells)) else [f"its header states {shown(stated)} rows, {len(cells)} are there"]
    if not told:
        notes.append("its header says nothing of inDegrees: angles are not read")
    return Recording(
        file=name,
        time=by_name["time"].copy(),
        points=np.column_stack([by_name[column] for column in columns]) if columns else np.empty((len(cells), 0)),
        joints={cell: unit * by_name[cell] for cell in wanted if cell != "time" and cell not in lengths},
        notes=tuple(notes),
    )
