"""SQLite index of a study's folders; the folders are the source, and the index can be rebuilt from them.

A session is read again if its folder changed or if some of its files were unreadable. So copied, removed and partly
written folders are noticed. Files that were edited in place are not noticed: delete index.db then.
"""

from __future__ import annotations

import json
import math
import os
import re
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.study.trial import Session, Trial
from rehab_opt.text_file import MAX_RECORDING_SIZE, file_content, shown

__all__ = ["INDEX", "Index", "content_of", "trial_format", "trials_in"]

INDEX, PERSON, SESSION, TRIAL, METRICS = "index.db", "person.json", "session.json", "trial.json", "metrics.json"
WAIT_S = 60.0
"""Longest time [s] that a process waits for another process that writes; writing a trial takes milliseconds."""
VERSION = 1
"""Version of the index format (PRAGMA user_version); an index with another version is rebuilt."""
SCHEMA = """
    CREATE TABLE sessions (
        id INTEGER PRIMARY KEY, person TEXT NOT NULL, "group" TEXT, name TEXT NOT NULL, visit INTEGER, date TEXT,
        stamp TEXT, UNIQUE (person, name));
    CREATE TABLE trials (
        id INTEGER PRIMARY KEY, session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE, number INTEGER NOT NULL,
        kind TEXT NOT NULL, condition TEXT, status TEXT NOT NULL, digest TEXT);
    CREATE INDEX trials_of_sessions ON trials (session);
    CREATE TABLE quantities (id INTEGER PRIMARY KEY, name TEXT NOT NULL, unit TEXT NOT NULL, UNIQUE (name, unit));
    CREATE TABLE measures (
        trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, quantity INTEGER NOT NULL REFERENCES quantities,
        value REAL NOT NULL, PRIMARY KEY (trial, quantity)) WITHOUT ROWID;
    CREATE TABLE bounds (
        trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, name TEXT NOT NULL, value REAL NOT NULL,
        bound REAL NOT NULL, unit TEXT NOT NULL);
    CREATE INDEX bounds_of_trials ON bounds (trial);
    CREATE TABLE events (
        trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, text TEXT NOT NULL, times REAL NOT NULL, unit TEXT);
    CREATE INDEX events_of_trials ON events (trial);
    CREATE TABLE outlines (trial INTEGER PRIMARY KEY REFERENCES trials ON DELETE CASCADE, points TEXT NOT NULL);
    CREATE TABLE bad (person TEXT NOT NULL, session TEXT NOT NULL, folder TEXT NOT NULL, why TEXT NOT NULL);
"""


@cache
def trial_format() -> Any:
    """Pydantic adapter that reads and writes `trial.json`."""
    from pydantic import TypeAdapter  # noqa: PLC0415

    return TypeAdapter(Trial)


def content_of(file: Path) -> dict[str, Any]:
    """Content of a JSON file of a study; {} if the file is missing.

    Raises
    ------
    ConfigurationError, ProblemFileError : the file cannot be read, or has no JSON object.
    """
    if not os.path.lexists(file):
        return {}
    try:
        content = json.loads(file_content(file, file.name, max_size=MAX_RECORDING_SIZE))
        json.dumps(content, ensure_ascii=False).encode()  # raises an error for half of a surrogate pair
    except (ValueError, RecursionError) as problem:
        raise ConfigurationError(file.name, shown(str(problem), 80), "JSON") from problem
    if not isinstance(content, dict):
        raise ConfigurationError(file.name, shown(str(content)), "a table in braces")
    return content


def trials_in(folder: Path) -> Sequence[Trial]:
    """Trials in a folder: the one in trial.json or, without that file, those in the metrics.json of a run.

    Raises
    ------
    ConfigurationError, ProblemFileError : both files are missing, or the file cannot be read.
    """
    if not (folder / TRIAL).exists():
        from rehab_opt.study.record import metric_trials  # noqa: PLC0415

        metrics = content_of(folder / METRICS).get("metrics")
        if not isinstance(metrics, dict):
            raise ConfigurationError(METRICS, None, f"a run's numbers, or {TRIAL} beside it")
        try:
            return metric_trials(metrics, Trial("run"))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as problem:
            raise ConfigurationError(METRICS, shown(str(problem)), "numbers as a run writes them") from problem
    try:
        return [trial_format().validate_json(file_content(folder / TRIAL, TRIAL, max_size=MAX_RECORDING_SIZE))]
    except ValueError as problem:  # pydantic's
        raise ConfigurationError(TRIAL, shown(" ".join(str(problem).split()), 120), "a trial") from problem


class Index:
    """The index of a study's folder; if its file cannot be written, the index is in memory.

    Raises
    ------
    ConfigurationError : the folder cannot be read, or another process blocks it for a minute.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with self.refusals():
            try:
                self._open(folder / INDEX)
            except sqlite3.OperationalError as problem:
                if _code(problem) == sqlite3.SQLITE_BUSY:
                    raise
                self._open(None)
            except sqlite3.DatabaseError:  # damaged, or of another version: rebuild the index
                for name in (INDEX, f"{INDEX}-journal"):
                    (folder / name).unlink(missing_ok=True)
                self._open(folder / INDEX)

    def _open(self, file: Path | None) -> None:
        if file is not None and not file.exists():
            try:
                os.close(os.open(file, os.O_CREAT, 0o600))
            except OSError as problem:
                raise sqlite3.OperationalError(str(problem)) from problem
        self.db = sqlite3.connect(file or ":memory:", timeout=WAIT_S, isolation_level=None)
        with ExitStack() as undo:
            undo.callback(self.db.close)
            for pragma in ("foreign_keys = ON", "secure_delete = ON", "synchronous = NORMAL", "cache_size = -65536"):
                self.db.execute(f"PRAGMA {pragma}")
            with self.transaction("DEFERRED" if self._version() == VERSION else "IMMEDIATE"):
                if self._version() not in (0, VERSION):
                    raise sqlite3.DatabaseError("another version")
                for statement in filter(str.strip, SCHEMA.split(";") if not self._version() else ()):
                    self.db.execute(statement)
                if not self._version():
                    self.db.execute(f"PRAGMA user_version = {VERSION}")
            self.follow()
            undo.pop_all()

    def _version(self) -> int:
        return int(self.db.execute("PRAGMA user_version").fetchone()[0])

    def rows(self, question: str, values: Sequence[Any] = ()) -> list[Any]:
        """Rows that a SELECT statement returns."""
        with self.refusals():
            return self.db.execute(question, values).fetchall()

    def bad(self) -> list[str]:
        """Unreadable files of the study, each with the reason."""
        found = self.rows("SELECT person, session, folder, why FROM bad ORDER BY 1, 2, 3")
        return [f"{'/'.join(filter(None, place))}: {why}" for *place, why in found]

    @contextmanager
    def refusals(self) -> Iterator[None]:
        """Context in which errors of SQLite and of the disk become `ConfigurationError`."""
        try:
            yield
        except (sqlite3.Error, OSError) as problem:
            why = "another process works on it" if _code(problem) == sqlite3.SQLITE_BUSY else shown(str(problem), 100)
            expected = f"a study that can be read and written to ({why})"
            raise ConfigurationError("study", str(self.folder), expected) from problem

    @contextmanager
    def transaction(self, kind: str = "IMMEDIATE") -> Iterator[None]:
        """Context of one SQLite transaction; with DEFERRED, all reads inside see the same state."""
        self.db.execute(f"BEGIN {kind}")
        with self.db:
            yield

    def follow(self) -> None:
        """Update the index: read new and changed sessions, and erase removed ones completely."""
        known = {
            (person, name): stamp for person, name, stamp in self.db.execute("SELECT person, name, stamp FROM sessions")
        }
        known |= dict.fromkeys(self.db.execute("SELECT person, session FROM bad"))  # may have been repaired since
        there: dict[tuple[str, str], str] = {}
        for person in _folders(self.folder):
            own = _stamp(f"{person.path}/{PERSON}")
            there |= {(person.name, session.name): _stamp(session.path) + own for session in _folders(person)}
        stale, gone = {place for place in there if known.get(place) != there[place]}, known.keys() - there
        if not stale and not gone:
            return
        with self.transaction():
            for place in gone:
                self.db.execute("DELETE FROM sessions WHERE person = ? AND name = ?", place)
                self.db.execute("DELETE FROM bad WHERE person = ? AND session = ?", place)
            for place in sorted(stale):
                self.read(*place)
            if gone:
                self.db.execute("DELETE FROM quantities WHERE id NOT IN (SELECT quantity FROM measures)")
        if {person for person, _ in gone} - {person for person, _ in there}:
            self.db.execute("VACUUM")  # also erases the person's name from inner pages of the database

    def read(self, person: str, name: str) -> None:
        """Read a session's folder into the index; call it within a transaction."""
        home, file = self.folder / person / name, self.folder / person / PERSON
        stamp, add = _stamp(home) + _stamp(file), self.db.execute
        add("DELETE FROM bad WHERE person = ? AND session = ?", (person, name))
        try:
            of = Session(person, name, **{"group": None, **content_of(file), **content_of(home / SESSION)})
        except (RehabOptError, TypeError) as refused:
            add("DELETE FROM sessions WHERE person = ? AND name = ?", (person, name))
            add("INSERT INTO bad VALUES (?, ?, '', ?)", (person, name, str(refused)))
            return
        facts = (of.group, of.visit, of.date, stamp, person, name)
        add("INSERT OR IGNORE INTO sessions (person, name) VALUES (?, ?)", (person, name))
        change = (
            'UPDATE sessions SET "group" = ?, visit = ?, date = ?, stamp = ? WHERE person = ? AND name = ? RETURNING id'
        )
        (session,) = add(change, facts).fetchone()
        there = {entry for entry in os.listdir(home) if entry[0] != "." and entry != SESSION}
        numbers = {int(entry): entry for entry in there if re.fullmatch(r"0\d\d|[1-9]\d{2,8}", entry, re.ASCII)}
        known = {number for (number,) in add("SELECT number FROM trials WHERE session = ?", (session,))}
        for number in known - numbers.keys():
            add("DELETE FROM trials WHERE session = ? AND number = ?", (session, number))
        bad = [(person, name, entry, "not a trial: a folder such as 001") for entry in there - {*numbers.values()}]
        for number in sorted(numbers.keys() - known):
            try:
                for trial in trials_in(home / numbers[number]):
                    self._insert(session, number, trial)
            except RehabOptError as refused:
                bad.append((person, name, numbers[number], str(refused)))
        self.db.executemany("INSERT INTO bad VALUES (?, ?, ?, ?)", bad)

    def _insert(self, session: int, number: int, trial: Trial) -> None:
        row = (session, number, trial.kind, trial.condition, trial.status, trial.digest)
        at = self.db.execute("INSERT INTO trials VALUES (NULL, ?, ?, ?, ?, ?, ?)", row).lastrowid
        found = [(value, name, unit) for name, value, unit in trial.measures if math.isfinite(value)]
        insert = f"INSERT INTO measures SELECT {at}, id, ? FROM quantities WHERE name = ? AND unit = ?"
        self.db.executemany("INSERT OR IGNORE INTO quantities (name, unit) VALUES (?, ?)", [each[1:] for each in found])
        self.db.executemany(insert, found)
        self.db.executemany("INSERT INTO bounds VALUES (?, ?, ?, ?, ?)", [(at, *each) for each in trial.bounds])
        self.db.executemany("INSERT INTO events VALUES (?, ?, ?, ?)", [(at, *each) for each in trial.events])
        if trial.outline:
            self.db.execute("INSERT INTO outlines VALUES (?, ?)", (at, json.dumps(trial.outline)))


def _code(problem: BaseException) -> int:
    return int(getattr(problem, "sqlite_errorcode", 0)) & 0xFF


def _folders(within: os.DirEntry[str] | Path) -> Iterator[os.DirEntry[str]]:
    """Folders inside a folder, without symbolic links, so that nothing outside a study is read or removed."""
    with os.scandir(within) as entries:
        yield from (each for each in entries if each.is_dir(follow_symlinks=False) and each.name[0] != ".")


def _stamp(path: str | Path) -> str:
    """Text that changes if an entry of the folder is created, renamed or removed, or the file is replaced."""
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return "absent "
    return f"{found.st_mtime_ns} {found.st_nlink} {found.st_ino} "
