"""One person's part of a study: copied out for them, or removed because they ask for it."""

from __future__ import annotations

import csv
import io
import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.parquet import COLUMNS
from rehab_opt.study.store import Study
from rehab_opt.text_file import write_whole

__all__ = ["RECORDING", "TABLE", "exported", "new_folder", "private_text", "removed"]

RECORDING, TABLE = "recording", "table"
"""Kinds of files that stay when a person goes: somebody else's recording; a table of many people, less their row."""
BESIDE_TABLE = ("groups.csv", "results.parquet")
"""What `many` writes beside a table, and anew when it is called again."""
PERSON, MEASURES = "person.json", "measures.csv"
OF_TRIALS = "FROM people p JOIN sessions s ON s.person = p.id JOIN trials t ON t.session = s.id "


def exported(study: Study, person: str | None, folder: Path) -> tuple[Path, ...]:
    """Write measures.csv, and of one person everything that the study holds, with their problems and traces.

    Parameters
    ----------
    person : None for the measures of everybody.
    folder : made; must not be there yet, or be empty.

    Raises
    ------
    ConfigurationError : nobody of that name, a folder with something in it or that cannot be written to.
    """
    if person is not None:
        check_there(study, person)
    try:
        new_folder(folder)
        with study.snapshot():
            written = [_write_measures(study, person, folder / MEASURES)]
            if person is not None:
                content, traces = _everything(study, person)
                written.append(private_text(folder / PERSON, json.dumps(content, indent=1, allow_nan=False) + "\n"))
                for path, number in traces.items():
                    (folder / "files").mkdir(exist_ok=True)
                    with suppress(FileNotFoundError):
                        written.append(Path(shutil.copyfile(path, folder / "files" / f"{number}-{path.name}")))
    except OSError as problem:
        raise ConfigurationError(
            "--out", str(folder), f"a folder that can be written to ({problem.strerror})"
        ) from problem
    return tuple(written)


def removed(study: Study, person: str) -> tuple[Path, ...]:
    """Remove a person: the traces that this library wrote, then their rows (`Study.forget`).

    Killed before its end, it is to be called again. What a disk keeps of a deleted file, and copies elsewhere, it does
    not reach.

    Returns
    -------
    Recordings of theirs, which stay where they are: they were not written by this library.

    Raises
    ------
    ConfigurationError : nobody has that name (free pages are overwritten anyway), or a trace cannot be removed.
    """
    kept = []
    question = f"SELECT DISTINCT f.path, f.kind {OF_TRIALS} JOIN files f ON f.trial = t.id WHERE p.name = ?"
    for file, kind in study.rows(question, (person,)):
        path = study.place(file)
        try:
            if kind == RECORDING:
                kept += [path] if path.exists() else []
            elif kind == TABLE:
                _without_rows(path, person)
                for name in BESIDE_TABLE:  # a group of one is one person
                    path.with_name(name).unlink(missing_ok=True)
            else:
                path.unlink(missing_ok=True)
                with suppress(OSError):  # a folder with something else in it stays
                    path.parent.rmdir()
        except OSError as problem:
            raise ConfigurationError(
                "traces", str(path), f"a file that can be removed ({problem.strerror})"
            ) from problem
    for (folder,) in study.rows("SELECT id FROM people WHERE name = ?", (person,)):  # what a killed process left, too
        left = study.traces / str(folder)
        try:
            if left.exists():
                shutil.rmtree(left)
        except OSError as problem:
            raise ConfigurationError("traces", str(left), f"a folder to remove ({problem.strerror})") from problem
    if not study.forget(person):
        raise ConfigurationError("--person", person, "somebody in this study")
    return tuple(kept)


def check_there(study: Study, person: str) -> None:
    """Refuse a person that a study does not know.

    Raises
    ------
    ConfigurationError : nobody of that name.
    """
    if not study.rows("SELECT 1 FROM people WHERE name = ?", (person,)):
        raise ConfigurationError("--person", person, "somebody in this study (rehab-opt study list says who)")


def new_folder(folder: Path) -> None:
    """Make a folder that its owner alone may enter.

    Raises
    ------
    ConfigurationError : something is in it, or it cannot be made.
    """
    try:
        if folder.exists() and any(folder.iterdir()):
            raise ConfigurationError("--out", str(folder), "a folder that is empty, or not there yet")
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.chmod(0o700)  # one that was there, too
    except OSError as problem:
        raise ConfigurationError("--out", str(folder), f"a folder ({problem.strerror})") from problem


def private_text(path: Path, text: str) -> Path:
    """Write a text that only its owner may read: whole, or not at all."""
    return write_whole(path, text.encode(), mode=0o600)


def _without_rows(table: Path, person: str) -> None:
    """A table of many people without the rows that begin with a person's name."""
    if not table.exists():
        return
    with table.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.reader(file) if row[:1] != [person]]
    left = io.StringIO()
    csv.writer(left, lineterminator="\n").writerows(rows)
    write_whole(table, left.getvalue().encode())


def _write_measures(study: Study, person: str | None, path: Path) -> Path:
    question = (
        'SELECT p.name, p."group", s.name, s.visit, s.date, t.number, t.condition, t.status, q.name, m.value, q.unit '
        f"{OF_TRIALS} JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity "
        "WHERE ?1 IS NULL OR p.name = ?1 ORDER BY p.id, s.id, t.number, q.id"
    )
    beside = private_text(path, "")
    with beside.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(study.each(question, (person,)))
    return path


def _everything(study: Study, person: str) -> tuple[dict[str, Any], dict[Path, int]]:
    """All that a study holds of a person, and their traces with the number that they get."""
    (group,) = study.rows('SELECT "group" FROM people WHERE name = ?', (person,))[0]
    sessions: dict[int, dict[str, Any]] = {}
    question = "SELECT s.id, s.name, s.visit, s.date FROM sessions s JOIN people p ON p.id = s.person WHERE p.name = ?"
    for at, name, visit, date in study.rows(question + " ORDER BY s.id", (person,)):
        sessions[at] = {"session": name, "visit": visit, "date": date, "trials": []}
    question = (
        "SELECT t.session, t.id, t.number, t.kind, t.condition, t.status, t.error, t.seconds, t.notes, t.written, "
        f"t.digest, v.versions, b.name, b.text {OF_TRIALS} LEFT JOIN software v ON v.id = t.software "
        "LEFT JOIN problems b ON b.id = t.problem WHERE p.name = ? ORDER BY t.session, t.number"
    )
    names = ("trial", "kind", "condition", "status", "error", "seconds", "notes", "written", "digest", "software",
             "problem", "problem_text")  # fmt: skip
    traces: dict[Path, int] = {}
    parts = {
        "measures": "SELECT name, value, unit FROM measures JOIN quantities ON id = quantity WHERE trial = ?",
        "bounds": "SELECT name, value, bound, unit FROM bounds WHERE trial = ?",
        "events": "SELECT text, times, unit FROM events WHERE trial = ?",
        "outline": "SELECT points FROM outlines WHERE trial = ?",
        "files": "SELECT path, kind FROM files WHERE trial = ?",
    }
    for at, number, *values in study.rows(question, (person,)):
        trial = dict(zip(names, values, strict=True))
        trial["notes"] = json.loads(trial["notes"])
        trial |= {part: [list(row) for row in study.rows(asked, (number,))] for part, asked in parts.items()}
        for path, kind in trial["files"]:
            if kind != TABLE:
                traces.setdefault(study.place(path), len(traces) + 1)
        sessions[at]["trials"].append(trial)
    return {"person": person, "group": group, "sessions": list(sessions.values())}, traces
