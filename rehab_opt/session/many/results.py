"""Results on disk: a folder for each person, and results.csv with a row for each. What is half written never counts."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from rehab_opt.session.many.participant import Answer, Cell
from rehab_opt.text_file import is_formula

__all__ = [
    "DONE", "FAILED", "NOT_RUN", "REFUSED", "Row", "counted", "failed_table", "forget", "keep", "kept_row",
    "write_groups", "write_rows",
]  # fmt: skip

DONE, REFUSED, FAILED, NOT_RUN = "done", "refused", "failed", "not run"
"""Of a row: computed; its input cannot be used; the computation failed; the run was interrupted before it."""
MARK = "result.json"
"""Written last: a folder without it holds no result."""


@dataclass(frozen=True)
class Row:
    """One person's line of results.csv.

    Parameters
    ----------
    status : DONE, REFUSED, FAILED or NOT_RUN.
    error : one line, why it is not done.
    seconds : what computing it took, whenever that was.
    numbers : metrics by dotted key.
    kept : True if it was there from an earlier run.
    inputs, covariates : of their row of a table.
    """

    participant: str
    status: str
    error: str = ""
    seconds: float | None = None
    numbers: Mapping[str, Cell] = field(default_factory=dict)
    kept: bool = False
    inputs: Mapping[str, str] = field(default_factory=dict)
    covariates: Mapping[str, str] = field(default_factory=dict)


def keep(participant: str, answer: Answer, folder: Path, digest: str) -> Row:
    """Put a person's result into their folder: each file whole or not at all, and the mark that they count last."""
    forget(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in answer.files.items():
        _replace(folder / name, content)
    mark = {
        "digest": digest,
        "seconds": answer.seconds,
        "files": sorted(answer.files),
        "numbers": dict(answer.numbers),
    }
    _replace(folder / MARK, (json.dumps(mark, indent=2) + "\n").encode())
    return Row(participant, DONE, seconds=answer.seconds, numbers=answer.numbers)


def kept_row(participant: str, folder: Path, digest: str) -> Row | None:
    """The row of a result of the same inputs that is there already; None where there is none."""
    mark = _mark(folder)
    if mark is None or mark["digest"] != digest or not all((folder / name).is_file() for name in mark["files"]):
        return None
    return Row(participant, DONE, seconds=mark["seconds"], numbers=mark["numbers"], kept=True)


def forget(folder: Path) -> None:
    """Remove an earlier result, so that none of other inputs stays behind; what is not ours stays."""
    mark = _mark(folder)
    (folder / MARK).unlink(missing_ok=True)
    for name in mark["files"] if mark is not None else ():
        (folder / Path(name).name).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def write_rows(rows: Sequence[Row], file: Path) -> None:
    """All rows; columns are what any of them has: covariates, inputs under `input.`, numbers."""
    covariates = list(dict.fromkeys(key for row in rows for key in row.covariates))
    inputs = list(dict.fromkeys(key for row in rows for key in row.inputs))
    columns = list(dict.fromkeys(key for row in rows for key in row.numbers))
    head = ["participant", "status", "error", "seconds", *covariates, *(f"input.{key}" for key in inputs), *columns]
    _write_csv(file, head, [
        [row.participant, row.status, row.error, row.seconds]
        + [row.covariates.get(key) for key in covariates]
        + [row.inputs.get(key) for key in inputs]
        + [row.numbers.get(key) for key in columns]
        for row in rows
    ])  # fmt: skip


def write_groups(rows: Sequence[Row], file: Path) -> None:
    """Every number of the rows that are done over each group and condition: how many, mean, spread, quartiles."""
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
    _replace(file, text.getvalue().encode())


def _written(cell: Cell) -> object:
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, str) and is_formula(cell):
        return f"'{cell}"  # a spreadsheet shows it, and computes nothing
    return f"{cell:.9g}" if isinstance(cell, float) else cell


def _replace(file: Path, content: bytes) -> None:
    beside = file.with_name(f".{file.name}.partial")
    beside.write_bytes(content)
    os.replace(beside, file)


def _mark(folder: Path) -> dict[str, Any] | None:
    """What the mark says; None where there is none, or none that can be read."""
    try:
        mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    there = isinstance(mark, dict) and {"digest", "seconds", "files", "numbers"} <= mark.keys()
    return mark if there else None


MOST_LISTED = 20


def counted(rows: Sequence[Row]) -> str:
    """How many are done, and how many of them were so before."""
    failed, kept = sum(bool(row.error) for row in rows), sum(row.kept for row in rows)
    said = f"{len(rows) - failed} of {len(rows)} participants done"
    return f"{said}, {kept} of them from an earlier run" if kept else said


def failed_table(rows: Sequence[Row]) -> Table:
    """Those that are not done and why, the first ones of them."""
    failed = [row for row in rows if row.error]
    more = len(failed) - MOST_LISTED
    table = Table(caption=f"{more} more are not done: see results.csv" if more > 0 else None)
    for column in ("participant", "status", "error"):
        table.add_column(column, overflow="fold")
    for row in failed[:MOST_LISTED]:
        table.add_row(Text(row.participant), row.status, Text(row.error))
    return table
