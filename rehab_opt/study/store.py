"""A study in one file: trials go in whole, a commit each, from any number of processes; and come out by question."""

from __future__ import annotations

import datetime
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.database import connected, refusals, transaction
from rehab_opt.study.parquet import kept_as_parquet, write_trace
from rehab_opt.study.trial import DONE, ProblemText, Session, StoredFile, Trial

__all__ = ["Study"]


class Study:
    """An open study.

        with Study("study.db") as study:
            study.add(Session("P01", "week 1", group="stroke"), Trial("live", measures))

    Parameters
    ----------
    file : SQLite, made where it is absent; on a disk of this machine, not of a network.
    create : False to refuse a file that is absent.

    Raises
    ------
    ConfigurationError : no study, of a later version, or not to be written to.
    """

    def __init__(self, file: str | Path, *, create: bool = True) -> None:
        self.file = Path(file)
        self._db = connected(self.file, create=create)

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file; the last one to do so leaves no -wal and no -shm behind."""
        self._db.close()

    def add(self, session: Session, trials: Trial | Sequence[Trial]) -> int:
        """Write trials, all of them in one commit; how many were new.

        A trial of the session with the same digest that is done is not written again; one that failed is replaced.
        Covariates of a session or a person that are not given now stay.

        Raises
        ------
        ConfigurationError : another group, visit or date than the study has; a file that cannot be written to.
        """
        many = [trials] if isinstance(trials, Trial) else list(trials)
        with refusals(self.file), transaction(self._db):
            person, at = self._place(session)
            quantities: dict[tuple[str, str], int] = {}
            new = 0
            kept: dict[int, StoredFile] = {}  # a trace that several trials share is written once
            for trial in many:
                number = self._add(at, trial, quantities)
                if number is not None:
                    new += 1
                    self._keep_trace(trial, kept, session, folder=f"{person}", number=number)
            return new

    def check(self, session: Session) -> None:
        """Refuse what `add` refuses of a session, and a file that cannot be written to; nothing of it is kept."""
        with refusals(self.file), transaction(self._db):
            self._db.execute("SAVEPOINT one")
            self._place(session)
            self._db.execute("ROLLBACK TO one")
            self._db.execute("RELEASE one")

    def admit(self, sessions: Iterable[Session]) -> list[ConfigurationError | None]:
        """Make room for sessions, all of them in one commit; of each None, or why it does not fit."""
        said: list[ConfigurationError | None] = []
        with refusals(self.file), transaction(self._db):
            for session in sessions:
                self._db.execute("SAVEPOINT one")
                try:
                    self._place(session)
                    said.append(None)
                except ConfigurationError as refused:
                    self._db.execute("ROLLBACK TO one")
                    said.append(refused)
                self._db.execute("RELEASE one")
        return said

    def has(self, session: Session, digest: str) -> bool:
        """Whether a trial of this session and digest is done, and its files are there."""
        found = self.rows(
            "SELECT t.id FROM trials t JOIN sessions s ON s.id = t.session JOIN people p ON p.id = s.person "
            "WHERE p.name = ? AND s.name = ? AND t.digest = ? AND t.status = ?",
            (session.person, session.name, digest, DONE),
        )
        if not found:
            return False
        paths = self.rows("SELECT path FROM files WHERE trial = ?", (found[0][0],))
        return all(self.place(path).exists() for (path,) in paths)

    def rows(self, question: str, values: Sequence[Any] = ()) -> list[Any]:
        """Rows of a SELECT."""
        with refusals(self.file):
            return self._db.execute(question, values).fetchall()

    def each(self, question: str, values: Sequence[Any] = ()) -> Iterator[Any]:
        """Rows of a SELECT one after another, for those that are too many to be held."""
        with refusals(self.file):
            yield from self._db.execute(question, values)

    @property
    def traces(self) -> Path:
        """Folder of the samples that the study keeps: one below it for each person, by their row."""
        return self.file.with_name(f"{self.file.name}-traces")

    def place(self, path: str) -> Path:
        """Where a file of a trial lies: paths below the study's folder are kept relative to it."""
        return self.file.absolute().parent / path

    def forget(self, person: str) -> bool:
        """Delete a person's rows, and problems that were theirs alone; whether they were there.

        What was deleted is overwritten with zeros in the file (secure_delete, VACUUM), and the log is cut to nothing.
        The files stay: `removed` of `rehab_opt.study.person` takes them, too.

        Raises
        ------
        ConfigurationError : another process is reading, so that the log cannot be cut: call it again.
        """
        with refusals(self.file):
            with transaction(self._db):
                gone = self._db.execute("DELETE FROM people WHERE name = ?", (person,)).rowcount
                self._db.execute(
                    "DELETE FROM problems WHERE id NOT IN (SELECT problem FROM trials WHERE problem IS NOT NULL)"
                )
            self._db.execute("VACUUM")  # what an index kept of a name in its inner pages goes, too
            busy = self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
        if busy:
            raise ConfigurationError("study", str(self.file), "nobody else reading it: its log holds old pages; repeat")
        return bool(gone)

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Everything read meanwhile is of one moment, whoever writes."""
        with refusals(self.file):
            self._db.execute("BEGIN")
            try:
                yield
            finally:
                self._db.execute("ROLLBACK")

    def _place(self, session: Session) -> tuple[int, int]:
        """Ids of a session's person and of itself, made where they are absent."""
        person = self._row_of("people", {"name": session.person}, {"group": session.group})
        dated = {"visit": session.visit, "date": session.date}
        return person, self._row_of("sessions", {"person": person, "name": session.name}, dated)

    def _row_of(self, table: str, key: dict[str, Any], facts: dict[str, Any]) -> int:
        """The id of a row, made where it is absent; what it does not say yet is filled in."""
        where = " AND ".join(f"{name} = ?" for name in key)
        columns = ", ".join(["id", *(f'"{name}"' for name in facts)])
        found = self._db.execute(f"SELECT {columns} FROM {table} WHERE {where}", (*key.values(),)).fetchone()
        if found is None:
            return self._inserted(table, key | facts)
        for (name, value), before in zip(facts.items(), found[1:], strict=True):
            if value is None or value == before:
                continue
            if before is not None:
                raise ConfigurationError(name, value, f"{before}, as the study has it for {key['name']}")
            self._db.execute(f'UPDATE {table} SET "{name}" = ? WHERE id = ?', (value, found[0]))
        return int(found[0])

    def _inserted(self, table: str, values: dict[str, Any]) -> int:
        columns, marks = ", ".join(f'"{name}"' for name in values), ", ".join("?" * len(values))
        made = self._db.execute(f"INSERT INTO {table} ({columns}) VALUES ({marks})", (*values.values(),))
        return int(made.lastrowid or 0)

    def _keep_trace(
        self, trial: Trial, kept: dict[int, StoredFile], session: Session, *, folder: str, number: int
    ) -> None:
        """Write a new trial's samples beside the study, before the commit: what is in it is there."""
        if trial.trace is None or not kept_as_parquet():
            return
        at = id(trial.trace)
        if at not in kept:
            file = self.traces / folder / f"{number}.parquet"
            kept[at] = StoredFile(write_trace(trial.trace, file, person=session.person, session=session.name))
        self._add_files(number, [kept[at]])

    def _add(self, session: int, trial: Trial, quantities: dict[tuple[str, str], int]) -> int | None:
        """The id of the trial; None where it is there already."""
        db = self._db
        if trial.digest is not None:
            question = "SELECT id, status FROM trials WHERE session = ? AND digest = ?"
            same = db.execute(question, (session, trial.digest)).fetchone()
            if same is not None and same[1] == DONE:
                if trial.status == DONE:
                    self._set_files(same[0], trial)
                return None
            if same is not None:
                db.execute("DELETE FROM trials WHERE id = ?", same[:1])
        (last,) = db.execute("SELECT coalesce(max(number), 0) FROM trials WHERE session = ?", (session,)).fetchone()
        software = None if trial.software is None else self._row_of("software", {"versions": trial.software}, {})
        values = {
            "session": session, "number": last + 1, "kind": trial.kind, "condition": trial.condition,
            "status": trial.status, "error": trial.error, "problem": self._problem(trial.problem), "software": software,
            "digest": trial.digest, "seconds": trial.seconds, "notes": json.dumps(list(trial.notes)),
            "written": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        }  # fmt: skip
        at = self._inserted("trials", values)
        for measure in trial.measures:
            key = (measure.name, measure.unit)
            if key not in quantities:
                quantities[key] = self._row_of("quantities", {"name": key[0], "unit": key[1]}, {})
        rows = [
            (at, quantities[each.name, each.unit], float(each.value) if math.isfinite(each.value) else None)
            for each in trial.measures
        ]
        db.executemany("INSERT INTO measures VALUES (?, ?, ?)", rows)
        self._set_files(at, trial)
        db.executemany(
            "INSERT INTO bounds VALUES (?, ?, ?, ?, ?)",
            [(at, b.name, float(b.value), float(b.bound), b.unit) for b in trial.bounds],
        )
        events = [(at, each.text, float(each.times), each.unit) for each in trial.events]
        db.executemany("INSERT INTO events (trial, text, times, unit) VALUES (?, ?, ?, ?)", events)
        if trial.outline:
            points = json.dumps([[round(x, 5), round(y, 5)] for x, y in trial.outline])
            db.execute("INSERT INTO outlines VALUES (?, ?)", (at, points))
        return at

    def _problem(self, problem: ProblemText | None) -> int | None:
        if problem is None:
            return None
        digest = hashlib.sha256("\0".join(problem).encode()).hexdigest()
        return self._row_of("problems", {"digest": digest}, {"name": problem.name, "text": problem.text})

    def _set_files(self, trial: int, of: Trial) -> None:
        """Add the files of a trial to those that it has; what is no longer there is removed."""
        for (path,) in self._db.execute("SELECT path FROM files WHERE trial = ?", (trial,)).fetchall():
            if not self.place(path).exists():
                self._db.execute("DELETE FROM files WHERE trial = ? AND path = ?", (trial, path))
        self._add_files(trial, of.files)

    def _add_files(self, trial: int, files: Sequence[StoredFile]) -> None:
        folder = self.file.absolute().parent
        for each in files:
            path = each.path.absolute()
            said = str(path.relative_to(folder) if path.is_relative_to(folder) else path)
            self._db.execute("INSERT OR IGNORE INTO files VALUES (?, ?, ?)", (trial, said, each.kind))
