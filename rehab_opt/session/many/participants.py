"""The people of a batch, from a folder of problem files or from a table whose rows change values of one problem.

The column `participant` has the person's name; every other column is a dotted key of the problem. The rules are in
`docs/howto/many_people.md`.
"""

from __future__ import annotations

import copy
import csv
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.kinematics.human_arm import RANGES_OF_MOTION_DEG
from rehab_opt.session.files import problem_content, problem_path
from rehab_opt.session.many.participant import COVARIATES, Participant, checked_name, unnamed, without_twins
from rehab_opt.text_file import DEEPEST_KEY, MAX_TABLE_SIZE, check_key_depth, header_cells, number_in, shown, whole_text

BASE = "upper_limb/workspace"
NAME = "participant"
ENDS = {"lower": 0, "upper": 1}
LONGEST_TITLE = 120


def participants_in_table(table: Path, *, problem: str = BASE) -> tuple[Participant, ...]:
    """The people of a table, one for each row; an error in one row is stored in that person's `error`.

    Parameters
    ----------
    table : path of a comma-separated file in UTF-8 with a header.
    problem : problem file whose values the rows change, or the name of a shipped problem.

    Raises
    ------
    ProblemFileError : the table or the problem file cannot be read, the column `participant` is missing or occurs
        twice, a column has no name, or there are no rows.
    """
    _, path = problem_path(problem)
    base = problem_content(path, problem)
    file = str(table)
    header, rows = _rows(table, file)
    people, keys = [], []
    for line, cells in rows:
        key = f"line {line}, column {NAME}"
        at = header.index(NAME)
        written = cells[at].strip() if at < len(cells) else ""
        row = f"{file}, line {line}"
        try:
            name = checked_name(written, file=file, key=key)
            people.append(_person(name, header, cells, base, file=row, path=path))
        except ProblemFileError as refused:
            people.append(unnamed(f"line {line}", written, file=row, path=path, error=refused))
        keys.append(key)
    if not people:
        raise ProblemFileError(file, "rows", 0, "a row for each participant")
    return without_twins(people, file=file, keys=keys)


def _rows(table: Path, file: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    text = whole_text(table, file, max_size=MAX_TABLE_SIZE)
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                rows.append((reader.line_num, cells))  # noqa: PERF401  (the number belongs to this moment)
    except csv.Error as problem:
        raise ProblemFileError(
            file, f"line {reader.line_num}", shown(str(problem)), "comma-separated cells"
        ) from problem
    if not rows:
        raise ProblemFileError(file, "rows", 0, "a header, and a row for each participant")
    line = rows[0][0]
    header, seen = header_cells(rows[0][1], name=file, line=line), set[str]()
    for i, column in enumerate(header, start=1):
        if not column:
            raise ProblemFileError(file, f"line {line}, column {i}", column, "a name: participant, or a dotted key")
        if column in seen:
            raise ProblemFileError(file, f"line {line}, column {i}", shown(column), "each column once")
        if column.count(".") >= DEEPEST_KEY:
            expected = f"a key of at most {DEEPEST_KEY} parts between dots"
            raise ProblemFileError(file, f"line {line}, column {i}", shown(column), expected)
        seen.add(column)
    if NAME not in header:
        found = shown(", ".join(header), 80)
        raise ProblemFileError(file, f"line {line}", found, f"a column {NAME} (cells are separated by commas)")
    return header, rows[1:]


def _person(
    name: str, header: Sequence[str], cells: Sequence[str], base: dict[str, Any], *, file: str, path: Path
) -> Participant:
    if len(cells) != len(header):
        refused = ProblemFileError(file, "cells", len(cells), f"{len(header)}, one for each column")
        return Participant(name, {}, file, path, str(refused))
    row = {key: cell.strip() for key, cell in zip(header, cells, strict=True) if key != NAME}
    covariates = {key: row.pop(key) for key in COVARIATES if key in row}
    given = {key: cell for key, cell in row.items() if cell}
    try:
        _check_segments(row, base, file=file)
        content, error = replaced(base, given, file=file), ""
    except ProblemFileError as problem:
        content, error = {}, str(problem)
    title = content.get("title")
    if "title" not in given and isinstance(title, str):
        content["title"] = f"{name}: {title}"[:LONGEST_TITLE]
    return Participant(name, content, file, path, error, row, covariates)


def _check_segments(row: dict[str, str], base: dict[str, Any], *, file: str) -> None:
    """Refuse an empty cell for a segment length that the problem does not define either."""
    for key, cell in row.items():
        *places, last = key.split(".")
        if cell or places[-1:] != ["segments"]:
            continue
        below: Any = base
        for part in (*places, last):
            below = below.get(part) if isinstance(below, dict) else None
        if below is None:
            raise ProblemFileError(file, key, "", "a length, or one in the problem for those whose cell is empty")


def replaced(base: dict[str, Any], given: dict[str, str], *, file: str) -> dict[str, Any]:
    """Copy of a problem's content in which the cells of a row replace values, by dotted key.

    Raises
    ------
    ProblemFileError : a key leads into a value that is not a table, or gives only one end of a pair.
    """
    content = copy.deepcopy(base)
    own: set[int] = set()  # ranges of motion that this row defines
    for key, cell in given.items():
        *places, last = key.split(".")
        into: Any = content
        for i, part in enumerate(places):
            after = places[i + 1] if i + 1 < len(places) else last
            into = _entered(into, part, after, own, key=key, cell=cell, file=file)
        _set(into, last, cell_value(cell), key=key, file=file)
    for key in given:
        *places, last = key.split(".")
        if last in ENDS:
            pair = _at(content, places)
            missing = [end for end, i in ENDS.items() if isinstance(pair, list) and pair[i] is None]
            if missing:
                raise ProblemFileError(file, ".".join((*places, missing[0])), None, "this cell, beside the other end")
    return content


def cell_value(cell: str) -> Any:
    """Value of a cell: a decimal number, true, false, a list or quoted text as in TOML; otherwise the text itself."""
    text = cell.strip()
    try:
        check_key_depth(text, name=cell)
        # The 0 after the cell detects a comment: without it, 29#0 would be read as 29.
        read = tomllib.loads(f"value = [{text}, 0]")
    except (ValueError, RecursionError):
        return text
    values = read["value"]
    if len(read) > 1 or len(values) != 2:  # the cell has further TOML lines, or several values
        return text
    value = values[0]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value if math.isfinite(number_in(text)) else text  # TOML also has 1_0, 0x10 and inf
    return value if isinstance(value, bool | str | list) else text


def _entered(into: Any, part: str, after: str, own: set[int], *, key: str, cell: str, file: str) -> Any:
    """Value of `into` at `part`, created if missing; `after` is the next part of the dotted key."""
    if isinstance(into, list) and part.isdecimal() and int(part) < len(into):
        return into[int(part)]
    if not isinstance(into, dict):
        raise ProblemFileError(file, key, shown(cell), f"a key of the problem: {part} stands in no table")
    below = into.get(part)
    if after in ENDS:
        if not (isinstance(below, list) and len(below) == 2):
            below = into[part] = [None, None]
    elif after.endswith("_deg") and isinstance(below, str) and below in RANGES_OF_MOTION_DEG:
        table = RANGES_OF_MOTION_DEG[below]
        below = into[part] = {f"{joint}_deg": list(limits) for joint, limits in table.items()}
    elif below is None or (_holds_named_ranges(part, below) and after.endswith("_deg") and id(below) not in own):
        below = into[part] = {}
        own.add(id(below))
    return below


def _holds_named_ranges(part: str, below: Any) -> bool:
    return part == "range_of_motion" and isinstance(below, dict) and not any(name.endswith("_deg") for name in below)


def _set(into: Any, last: str, value: Any, *, key: str, file: str) -> None:
    if isinstance(into, list) and (last in ENDS or last.isdecimal()):
        i = ENDS.get(last, int(last) if last.isdecimal() else 0)
        if i < len(into):
            into[i] = value
            return
    if not isinstance(into, dict):
        raise ProblemFileError(file, key, value, "a key of the problem: what it leads into is no table")
    into[last] = value


def _at(content: Any, places: Sequence[str]) -> Any:
    for part in places:
        content = content[int(part)] if isinstance(content, list) else content[part]
    return content


def participants_of(source: Path, *, problem: str | None = None) -> tuple[Participant, ...]:
    """The people of a folder of problem files, or of a table whose rows change values of one problem.

    An invalid or repeated name is stored in the person's `error`.

    Parameters
    ----------
    source : folder with a `.toml` for each person, or path of a `.csv` table.
    problem : problem file whose values the rows of a table change, or the name of a shipped problem; by default
        `upper_limb/workspace`.

    Raises
    ------
    ProblemFileError : there are no people, or the table has no column `participant`.
    ConfigurationError : `source` is a folder and `problem` is given.
    """
    if source.is_dir():
        if problem is not None:
            raise ConfigurationError("--problem", problem, "no such option with a folder, whose files are problems")
        return participants_in_folder(source)
    if not source.exists():
        raise ProblemFileError(shown(str(source), 200), "file", "not found", "a folder of problem files, or a .csv")
    if source.suffix.lower() != ".csv":
        raise ProblemFileError(source, "file", source.name, "a folder of problem files, or a table ending in .csv")
    return participants_in_table(source, problem=problem or BASE)


def participants_in_folder(folder: Path) -> tuple[Participant, ...]:
    """The people of a folder, one for each `.toml` in it, named after the file; raises as `participants_of`."""
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".toml")
    if not files:
        raise ProblemFileError(folder, "folder", "no .toml in it", "a problem file for each participant")
    people = []
    for path in files:
        try:
            name = checked_name(path.stem, file=folder, key=path.name)
        except ProblemFileError as refused:
            people.append(unnamed("file", path.name, file=str(path), path=path, error=refused))
            continue
        try:
            people.append(Participant(name, problem_content(path, str(path)), str(path), path))
        except RehabOptError as refused:
            people.append(Participant(name, {}, str(path), path, str(refused)))
    return without_twins(people, file=folder, keys=[path.name for path in files])
