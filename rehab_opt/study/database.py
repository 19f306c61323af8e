"""The file of a study: SQLite in WAL mode, its tables, and how an older version becomes the present one."""

from __future__ import annotations

import os
import sqlite3
import stat
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from rehab_opt.errors import ConfigurationError
from rehab_opt.text_file import shown

__all__ = ["APPLICATION", "VERSIONS", "connected", "own_alone", "refusals", "transaction"]

APPLICATION = 0x52484F53
"""PRAGMA application_id of a study: another program's database is not written into."""
WHY = {
    sqlite3.SQLITE_FULL: "the disk is full",
    sqlite3.SQLITE_IOERR: "the disk is full, or fails",
    sqlite3.SQLITE_READONLY: "the file, its folder or the disk is read-only, or full",
    sqlite3.SQLITE_CANTOPEN: "its folder cannot be written to, where a log is kept beside it while it is open",
}
"""What SQLite's errors are to a user, by their primary code; its own words for others."""
WAIT_S = 60.0
"""[s] that one writer waits for another; a trial takes milliseconds."""
VERSIONS: tuple[str, ...] = (
    # A trial of a session by its number, and once for what it depends on (digest).
    """
    CREATE TABLE people (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, "group" TEXT);
    CREATE TABLE sessions (
        id INTEGER PRIMARY KEY, person INTEGER NOT NULL REFERENCES people ON DELETE CASCADE, name TEXT NOT NULL,
        visit INTEGER, date TEXT, UNIQUE (person, name));
    CREATE TABLE problems (id INTEGER PRIMARY KEY, digest TEXT NOT NULL UNIQUE, name TEXT NOT NULL, text TEXT NOT NULL);
    CREATE TABLE software (id INTEGER PRIMARY KEY, versions TEXT NOT NULL UNIQUE);
    CREATE TABLE trials (
        id INTEGER PRIMARY KEY, session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE,
        number INTEGER NOT NULL, kind TEXT NOT NULL, condition TEXT, status TEXT NOT NULL, error TEXT NOT NULL,
        problem INTEGER REFERENCES problems, software INTEGER REFERENCES software, digest TEXT, seconds REAL,
        notes TEXT NOT NULL, written TEXT NOT NULL, UNIQUE (session, number), UNIQUE (session, digest));
    CREATE TABLE quantities (id INTEGER PRIMARY KEY, name TEXT NOT NULL, unit TEXT NOT NULL, UNIQUE (name, unit));
    CREATE TABLE measures (
        trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, quantity INTEGER NOT NULL REFERENCES quantities,
        value REAL, PRIMARY KEY (trial, quantity)) WITHOUT ROWID;
    CREATE TABLE files (
        trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, path TEXT NOT NULL, kind TEXT NOT NULL,
        PRIMARY KEY (trial, path)) WITHOUT ROWID;
    """,
    # What a report needs beside numbers: bounds with what came nearest to them, safety events, the ground covered.
    """
    CREATE TABLE bounds (
        trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, name TEXT NOT NULL, value REAL NOT NULL,
        bound REAL NOT NULL, unit TEXT NOT NULL, PRIMARY KEY (trial, name)) WITHOUT ROWID;
    CREATE TABLE events (
        id INTEGER PRIMARY KEY, trial INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE, text TEXT NOT NULL,
        times REAL NOT NULL, unit TEXT NOT NULL);
    CREATE INDEX events_of_trials ON events (trial);
    CREATE TABLE outlines (trial INTEGER PRIMARY KEY REFERENCES trials ON DELETE CASCADE, points TEXT NOT NULL);
    """,
)
"""Each step from one version to the next; PRAGMA user_version says how many have been done."""


def connected(file: Path, *, create: bool) -> sqlite3.Connection:
    """An open study, of the present version; file, -wal and -shm belong to their owner alone (0600).

    Parameters
    ----------
    create : make the file where it is absent.

    Raises
    ------
    ConfigurationError : absent, no study, of a later version, or not to be written to.
    """
    try:
        if create:
            with suppress(FileExistsError):
                file.parent.mkdir(parents=True, exist_ok=True)
                os.close(os.open(file, os.O_CREAT | os.O_EXCL, 0o600))  # SQLite gives -wal and -shm the same mode
        if not file.is_file() or not (create or file.stat().st_size):
            raise ConfigurationError("study", str(file), "a study's file (rehab-opt run --study FILE makes one)")
    except OSError as problem:
        raise ConfigurationError("study", str(file), f"a file that can be written to ({problem.strerror})") from problem
    with refusals(file):
        try:
            return _opened(file)
        except sqlite3.OperationalError:
            log = own_alone(file)[0]
            if create or (log.exists() and log.stat().st_size):  # a log with trials in it must be read, too
                raise
            return _opened(file, as_it_lies=True)


def _opened(file: Path, *, as_it_lies: bool = False) -> sqlite3.Connection:
    """A connection; `as_it_lies` reads without the log, on a disk that is full or in a folder that is read-only."""
    with ExitStack() as undo:
        # absolute: SQLite keeps what is called ":memory:" in memory
        name = f"{file.absolute().as_uri()}{'?immutable=1' if as_it_lies else ''}"
        made = sqlite3.connect(name, timeout=WAIT_S, isolation_level=None, uri=True)
        undo.callback(made.close)
        made.execute("PRAGMA foreign_keys = ON")
        made.execute("PRAGMA secure_delete = ON")
        made.execute("PRAGMA synchronous = FULL")  # a finished trial outlives a cut of power
        _check_ours(made, file)
        if not as_it_lies:
            _make_private(file)  # not before: another program's file keeps its mode
            _log_ahead(made)
        _migrate(made, file)
        made.execute("SELECT count(*) FROM people")
        undo.pop_all()
    return made


def own_alone(file: Path) -> tuple[Path, Path]:
    """The files that SQLite keeps beside a study while it is open."""
    return file.with_name(f"{file.name}-wal"), file.with_name(f"{file.name}-shm")


@contextmanager
def refusals(file: Path) -> Iterator[None]:
    """SQLite's own errors as this library's.

    Raises
    ------
    ConfigurationError : in place of any `sqlite3.Error`.
    """
    try:
        yield
    except sqlite3.Error as problem:
        why = WHY.get(getattr(problem, "sqlite_errorcode", 0) & 0xFF, shown(str(problem), 100))
        expected = f"a study that can be read and written to ({why})"
        raise ConfigurationError("study", str(file), expected) from problem


@contextmanager
def transaction(of: sqlite3.Connection) -> Iterator[None]:
    """All of it or nothing; other writers wait."""
    of.execute("BEGIN IMMEDIATE")
    with ExitStack() as undo:
        undo.callback(lambda: of.in_transaction and of.execute("ROLLBACK"))
        yield
        of.execute("COMMIT")
        undo.pop_all()


def _pragma(of: sqlite3.Connection, name: str) -> int:
    return int(of.execute(f"PRAGMA {name}").fetchone()[0])


def _check_ours(of: sqlite3.Connection, file: Path) -> None:
    # tables first: who makes the study at this moment writes its id together with them, so that it is there by now
    tables = of.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if tables and _pragma(of, "application_id") != APPLICATION:
        raise ConfigurationError("study", str(file), "a study, this is another program's database")


def _make_private(file: Path) -> None:
    try:
        for each in (file, *own_alone(file)):
            if each.exists() and stat.S_IMODE(each.stat().st_mode) & 0o077:
                each.chmod(0o600)
    except OSError as problem:
        raise ConfigurationError("study", str(file), f"a file that can be written to ({problem.strerror})") from problem


def _log_ahead(of: sqlite3.Connection) -> None:
    """WAL mode. SQLite does not wait here for another process that makes the study at the same moment: we do."""
    until = time.monotonic() + WAIT_S
    while True:
        try:
            of.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as problem:
            if problem.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() > until:
                raise
            time.sleep(0.01)
        else:
            return


def _migrate(of: sqlite3.Connection, file: Path) -> None:
    present = _pragma(of, "user_version")
    if present > len(VERSIONS):
        raise ConfigurationError("study", str(file), f"version {len(VERSIONS)} at most, this is {present}: update")
    if present == len(VERSIONS):
        return
    with transaction(of):
        present = _pragma(of, "user_version")  # another process may have been first
        for step in VERSIONS[present:]:
            for statement in filter(str.strip, step.split(";")):
                of.execute(statement)
        of.execute(f"PRAGMA application_id = {APPLICATION}")
        of.execute(f"PRAGMA user_version = {len(VERSIONS)}")
