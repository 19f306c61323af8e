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

from rehab_opt.session.many.work import Answer, Cell

__all__ = ["DONE", "FAILED", "NOT_RUN", "REFUSED", "Row", "forget", "keep", "kept_row", "write_rows"]

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
    """

    participant: str
    status: str
    error: str = ""
    seconds: float | None = None
    numbers: Mapping[str, Cell] = field(default_factory=dict)
    kept: bool = False


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
    """All rows; columns are what any of them has."""
    columns = list(dict.fromkeys(key for row in rows for key in row.numbers))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["participant", "status", "error", "seconds", *columns])
    for row in rows:
        cells = [row.numbers.get(column) for column in columns]
        writer.writerow(map(_written, [row.participant, row.status, row.error, row.seconds, *cells]))
    _replace(file, text.getvalue().encode())


def _written(cell: Cell) -> object:
    if isinstance(cell, bool):
        return str(cell).lower()
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
