"""Results on disk: a folder for each person, and results.csv with one row for each. Incomplete results never count."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from rehab_opt.session.many.participant import Cell, PersonResult
from rehab_opt.text_file import is_formula, write_whole

__all__ = [
    "DONE", "FAILED", "NOT_RUN", "REFUSED", "ResultRow", "counted", "failed_table", "forget", "keep", "kept_row",
    "write_groups", "write_parquet", "write_rows",
]  # fmt: skip

DONE, REFUSED, FAILED, NOT_RUN = "done", "refused", "failed", "not run"
"""Status of a row: computed; invalid input; failed computation; interrupted before its turn."""
MARK = "result.json"
"""Written last: a folder without it has no result."""


@dataclass(frozen=True)
class ResultRow:
    """One person's line of results.csv.

    Parameters
    ----------
    status : DONE, REFUSED, FAILED or NOT_RUN.
    error : one line, the reason why it is not done.
    seconds : computing time, also of an earlier run.
    numbers : metrics by dotted key.
    kept : True for a result of an earlier run.
    inputs, covariates : from the person's row in a table.
    """

    participant: str
    status: str
    error: str = ""
    seconds: float | None = None
    numbers: Mapping[str, Cell] = field(default_factory=dict)
    kept: bool = False
    inputs: Mapping[str, str] = field(default_factory=dict)
    covariates: Mapping[str, str] = field(default_factory=dict)


def keep(participant: str, answer: PersonResult, folder: Path, digest: str) -> ResultRow:
    """Write a person's result into their folder: each file completely or not at all, and the mark last."""
    forget(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in answer.files.items():
        write_whole(folder / name, content)
    mark = {
        "digest": digest,
        "seconds": answer.seconds,
        "files": sorted(answer.files),
        "numbers": dict(answer.numbers),
    }
    write_whole(folder / MARK, (json.dumps(mark, indent=2) + "\n").encode())
    return ResultRow(participant, DONE, seconds=answer.seconds, numbers=_named_once(answer.numbers))


def kept_row(participant: str, folder: Path, digest: str) -> ResultRow | None:
    """The row of an existing result with the same inputs; None if there is none."""
    mark = _mark(folder)
    if mark is None or mark["digest"] != digest or not all((folder / name).is_file() for name in mark["files"]):
        return None
    return ResultRow(participant, DONE, seconds=mark["seconds"], numbers=_named_once(mark["numbers"]), kept=True)


def _named_once(numbers: Mapping[str, Cell]) -> dict[str, Cell]:
    """The numbers under names that all rows share, because names for 10 000 people need much memory."""
    return {sys.intern(key): value for key, value in numbers.items()}


def forget(folder: Path) -> None:
    """Remove an earlier result with other inputs; files that are not ours stay."""
    mark = _mark(folder)
    (folder / MARK).unlink(missing_ok=True)
    for name in mark["files"] if mark is not None else ():
        (folder / Path(name).name).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def write_rows(rows: Sequence[ResultRow], file: Path) -> None:
    """Write all rows; the columns are the union of their covariates, inputs (as `input.`) and numbers."""
    table = _columns(rows)
    _write_csv(file, list(table), list(zip(*table.values(), strict=True)))


def write_parquet(rows: Sequence[ResultRow], file: Path) -> None:
    """Write the same rows with typed columns of numbers, truth values or texts; without pyarrow, no file."""
    file.unlink(missing_ok=True)
    if importlib.util.find_spec("pyarrow") is None:
        return
    import pyarrow  # noqa: PLC0415
    import pyarrow.parquet  # noqa: PLC0415

    content = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table({key: _typed(of) for key, of in _columns(rows).items()}), content)
    write_whole(file, content.getvalue())


def _columns(rows: Sequence[ResultRow]) -> dict[str, list[Cell]]:
    covariates = dict.fromkeys(key for row in rows for key in row.covariates)
    inputs = dict.fromkeys(key for row in rows for key in row.inputs)
    numbers = dict.fromkeys(key for row in rows for key in row.numbers)
    columns: dict[str, list[Cell]] = {
        "participant": [row.participant for row in rows],
        "status": [row.status for row in rows],
        "error": [row.error for row in rows],
        "seconds": [row.seconds for row in rows],
        **{key: [row.covariates.get(key) for row in rows] for key in covariates},
        **{f"input.{key}": [row.inputs.get(key) for row in rows] for key in inputs},
    }
    for key in numbers:  # a kind of problem from elsewhere may have a number of any name
        columns[f"metrics.{key}" if key in columns else key] = [row.numbers.get(key) for row in rows]
    return columns


def _typed(cells: Sequence[Cell]) -> Sequence[Cell]:
    """Cells of one type: unchanged if all are texts or all are truth values, else numbers, else texts."""
    kinds = {type(cell) for cell in cells if cell is not None}
    if kinds <= {int, float}:
        return [None if cell is None else float(cell) for cell in cells]
    return cells if len(kinds) == 1 else [None if cell is None else str(cell) for cell in cells]


def write_groups(rows: Sequence[ResultRow], file: Path) -> None:
    """Write count, mean, spread and quartiles of each number over the finished rows of each group and condition."""
    of: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        group, condition = (row.covariates.get(key) or "all" for key in ("group", "condition"))
        for name, value in row.numbers.items() if row.status == DONE else ():
            if isinstance(value, int | float) and not isinstance(value, bool):
                of.setdefault((group, condition, name), []).append(float(value))
    head = ["group", "condition", "measure", "people", "mean", "sd", "min", "q1", "median", "q3", "max"]
    rows_of = []
    for (group, condition, name), values in sorted(of.items(), key=lambda item: item[0][:2]):
        n, spread = len(values), float(np.std(values, ddof=1)) if len(values) > 1 else None
        quartiles = map(float, np.percentile(values, (0, 25, 50, 75, 100)))
        rows_of.append([group, condition, name, n, float(np.mean(values)), spread, *quartiles])
    _write_csv(file, head, rows_of)


def _write_csv(file: Path, head: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([_written(cell) for cell in row] for row in rows)
    write_whole(file, text.getvalue().encode())


def _written(cell: Cell) -> object:
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, str) and is_formula(cell):
        return f"'{cell}"  # a spreadsheet shows it, and computes nothing
    return f"{cell:.9g}" if isinstance(cell, float) else cell


def _mark(folder: Path) -> dict[str, Any] | None:
    """Content of the mark; None if there is none, or it cannot be read."""
    try:
        mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    there = isinstance(mark, dict) and {"digest", "seconds", "files", "numbers"} <= mark.keys()
    return mark if there else None


MAX_LISTED = 20


def counted(rows: Sequence[ResultRow]) -> str:
    """Number of finished people, and how many of them are from earlier runs."""
    failed, kept = sum(bool(row.error) for row in rows), sum(row.kept for row in rows)
    said = f"{len(rows) - failed} of {len(rows)} participants done"
    return f"{said}, {kept} of them from an earlier run" if kept else said


def failed_table(rows: Sequence[ResultRow]) -> Table:
    """The first people who are not done, with the reasons."""
    failed = [row for row in rows if row.error]
    more = len(failed) - MAX_LISTED
    table = Table(caption=f"{more} more are not done: see results.csv" if more > 0 else None)
    for column in ("participant", "status", "error"):
        table.add_column(column, overflow="fold")
    for row in failed[:MAX_LISTED]:
        table.add_row(Text(row.participant), row.status, Text(row.error))
    return table
