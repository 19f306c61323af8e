"""Results of a batch on disk: a folder for each person, and results.csv with a row for each person."""

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

DONE, REFUSED, FAILED, NOT_RUN = "done", "refused", "failed", "not run"
"""Status of a row: computed; invalid input; failed computation; not started when the batch was interrupted."""
MARK = "result.json"
"""File that is written last; a folder without this file has no complete result."""


@dataclass(frozen=True)
class ResultRow:
    """One person's row of results.csv.

    Parameters
    ----------
    participant : name of the person.
    status : DONE, REFUSED, FAILED or NOT_RUN.
    error : reason in one line why the person is not done.
    seconds : computing time [s] of the run that made the result.
    numbers : metrics by dotted key.
    kept : whether the result is from an earlier run.
    inputs, covariates : cells of the person's row in the input table.
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
    """Write the files of a person's result to `folder`, and result.json last."""
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
    """The row of an existing result with the same inputs; None if there is no such result."""
    mark = _mark(folder)
    if mark is None or mark["digest"] != digest or not all((folder / name).is_file() for name in mark["files"]):
        return None
    return ResultRow(participant, DONE, seconds=mark["seconds"], numbers=_named_once(mark["numbers"]), kept=True)


def _named_once(numbers: Mapping[str, Cell]) -> dict[str, Cell]:
    """The numbers with interned names, which all rows share in memory."""
    return {sys.intern(key): value for key, value in numbers.items()}


def forget(folder: Path) -> None:
    """Remove the files of an earlier result from `folder`; other files stay."""
    mark = _mark(folder)
    (folder / MARK).unlink(missing_ok=True)
    for name in mark["files"] if mark is not None else ():
        (folder / Path(name).name).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def write_rows(rows: Sequence[ResultRow], file: Path) -> None:
    """Write all rows as CSV, with columns for all covariates, inputs (prefixed by `input.`) and numbers."""
    table = _columns(rows)
    _write_csv(file, list(table), list(zip(*table.values(), strict=True)))


def write_parquet(rows: Sequence[ResultRow], file: Path) -> None:
    """Write all rows as Parquet, with columns of numbers, truth values or texts; without pyarrow, write no file."""
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
    for key in numbers:  # a user's own system may have a metric with the name of another column
        columns[f"metrics.{key}" if key in columns else key] = [row.numbers.get(key) for row in rows]
    return columns


def _typed(cells: Sequence[Cell]) -> Sequence[Cell]:
    """Cells of one column, converted to one type: truth values, numbers or texts."""
    kinds = {type(cell) for cell in cells if cell is not None}
    if kinds <= {int, float}:
        return [None if cell is None else float(cell) for cell in cells]
    return cells if len(kinds) == 1 else [None if cell is None else str(cell) for cell in cells]


def write_groups(rows: Sequence[ResultRow], file: Path) -> None:
    """Write count, mean, standard deviation and quartiles of each metric, for each group and condition of people."""
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
        return f"'{cell}"  # the apostrophe makes a spreadsheet show the text instead of evaluating it
    return f"{cell:.9g}" if isinstance(cell, float) else cell


def _mark(folder: Path) -> dict[str, Any] | None:
    """Content of a folder's result.json; None if the file is missing or cannot be read."""
    try:
        mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    there = isinstance(mark, dict) and {"digest", "seconds", "files", "numbers"} <= mark.keys()
    return mark if there else None


MAX_LISTED = 20


def counted(rows: Sequence[ResultRow]) -> str:
    """Sentence with the numbers of finished people, of all people, and of people finished in an earlier run."""
    failed, kept = sum(bool(row.error) for row in rows), sum(row.kept for row in rows)
    said = f"{len(rows) - failed} of {len(rows)} participants done"
    return f"{said}, {kept} of them from an earlier run" if kept else said


def failed_table(rows: Sequence[ResultRow]) -> Table:
    """Table of the first 20 people who are not done, with the reasons."""
    failed = [row for row in rows if row.error]
    more = len(failed) - MAX_LISTED
    table = Table(caption=f"{more} more are not done: see results.csv" if more > 0 else None)
    for column in ("participant", "status", "error"):
        table.add_column(column, overflow="fold")
    for row in failed[:MAX_LISTED]:
        table.add_row(Text(row.participant), row.status, Text(row.error))
    return table
