"""A study is a folder of trials, each complete or absent, written by any number of processes; queries go to its index.

study/P01/person.json                 {"group": "stroke"}
study/P01/week 1/session.json         {"visit": 1, "date": "2026-11-23"}
study/P01/week 1/001/                 trial.json, trace.csv and the metrics.json of a run
study/study.json, index.db            list of exports; an index, rebuilt if it is missing
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.index import METRICS, PERSON, SESSION, TRIAL, Index, content_of, trial_format, trials_in
from rehab_opt.study.trial import DONE, Session, Trial
from rehab_opt.text_file import write_whole

__all__ = ["Study", "private"]

MARK = "study.json"
PARTIAL = ".partial"


class Study(Index):
    """An open study.

        with Study("arm") as study:
            study.add(Session("P01", "week 1", group="stroke"), Trial("live", measures))

    Parameters
    ----------
    folder : is created if it is missing; only its owner may enter.
    create : False refuses a missing folder.

    Raises
    ------
    ConfigurationError : the folder is no study, or cannot be read.
    """

    def __init__(self, folder: str | Path, *, create: bool = True) -> None:
        folder = Path(folder)
        mark = folder / MARK
        try:
            if create and not mark.exists() and not (folder.exists() and any(folder.iterdir())):
                folder.mkdir(parents=True, exist_ok=True, mode=0o700)
                with suppress(FileExistsError), mark.open("x", encoding="utf-8") as made:  # another process was first
                    made.write("{}\n")
                mark.chmod(0o600)
            if not mark.is_file():
                raise ConfigurationError(
                    "study",
                    str(folder),
                    f"a study's folder, with {MARK} in it (rehab-opt run --study makes one; a lost {MARK} is {{}})",
                )
            if folder.stat().st_mode & 0o077 and os.access(folder, os.W_OK):
                folder.chmod(0o700)
        except OSError as problem:
            expected = f"a folder that can be written to ({problem.strerror})"
            raise ConfigurationError("study", str(folder), expected) from problem
        super().__init__(folder)

    def __enter__(self) -> Self:
        """The study."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close the index."""
        self.close()

    def close(self) -> None:
        """Close the index."""
        self.db.close()

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Context in which no other process writes.

        Raises
        ------
        ConfigurationError : a folder that cannot be written to.
        """
        with self.refusals(), self.transaction():
            yield

    def add(self, session: Session, trials: Trial | Sequence[Trial]) -> int:
        """Write trials, one after the other; returns the number of new ones.

        A finished trial of the session with the same digest is not written again; a failed one is replaced. Covariates
        of a session or a person that are not given now stay unchanged.

        Raises
        ------
        ConfigurationError : group, visit or date differ from those in the study; a folder that cannot be written to.
        """
        new, copies = 0, dict[int, Path]()  # a trace that several trials have lies on the disk once
        with self.writing():
            home = self._room(session)
            self.read(session.person, session.name)
            for trial in [trials] if isinstance(trials, Trial) else trials:
                question = "SELECT number, status FROM trials t JOIN sessions s ON s.id = t.session WHERE "
                of = (session.person, session.name, trial.digest)
                same = self.rows(f"{question} person = ? AND name = ? AND digest = ?", of)
                if any(status == DONE for _, status in same):
                    self._known_by(trial, home / f"{same[0][0]:03}")
                    continue
                self._write(trial, home, copies)
                for number, _ in same:
                    shutil.rmtree(home / f"{number:03}")
                self.read(session.person, session.name)
                new += 1
        return new

    def check(self, session: Session) -> None:
        """Raise the errors of `add` for a session and its folder, without writing."""
        with self.writing():
            _agreed(self.folder / session.person / PERSON, {"group": session.group}, session.person)
            dated = {"visit": session.visit, "date": session.date}
            _agreed(self.folder / session.person / session.name / SESSION, dated, session.name)

    def admit(self, sessions: Iterable[Session]) -> list[ConfigurationError | None]:
        """Create the folders of sessions; for each None, or the reason why it does not fit."""
        refusals: list[ConfigurationError | None] = []
        with self.writing():
            for session in sessions:
                try:
                    self._room(session)
                    self.read(session.person, session.name)
                    refusals.append(None)
                except ConfigurationError as refused:
                    refusals.append(refused)
        return refusals

    def _room(self, session: Session) -> Path:
        """The folder of a session, created with the known facts about person and session."""
        home = self.folder / session.person / session.name
        files = {
            home.parent / PERSON: _agreed(home.parent / PERSON, {"group": session.group}, session.person),
            home / SESSION: _agreed(home / SESSION, {"visit": session.visit, "date": session.date}, session.name),
        }
        home.mkdir(parents=True, exist_ok=True)
        for file, content in files.items():
            if content != content_of(file):
                private(file, json.dumps(content) + "\n")
        return home

    def _write(self, trial: Trial, home: Path, copies: dict[int, Path]) -> None:
        """The trial's folder, with the next free number; it has a temporary name until it is complete on disk."""
        shutil.rmtree(home / PARTIAL, ignore_errors=True)  # of a process that was killed
        numbers = [int(each) for each in os.listdir(home) if each.isascii() and each.isdecimal()]
        scratch, target = home / PARTIAL, home / f"{1 + max(numbers, default=0):03}"
        scratch.mkdir()
        samples = {METRICS: next((each.path for each in trial.files if each.path.name == METRICS), None),
                   "trace.csv": trial.trace}  # fmt: skip
        for name, source in samples.items():
            if source is not None and id(source) in copies:
                try:
                    os.link(copies[id(source)], scratch / name)
                except OSError:  # a disk without links
                    shutil.copyfile(copies[id(source)], scratch / name)
            elif source is not None:
                private(scratch / name, source.read_bytes() if isinstance(source, Path) else _table(source))
                copies[id(source)] = target / name
        private(scratch / TRIAL, trial_format().dump_json(_storable(trial), indent=1, exclude={"trace"}))
        scratch.rename(target)
        if os.name == "posix":  # its name, too, outlives a cut of power
            at = os.open(home, os.O_RDONLY)
            os.fsync(at)
            os.close(at)

    def _known_by(self, trial: Trial, folder: Path) -> None:
        """Add external files to those of an existing trial: they are removed with the person, too."""
        (before,) = trials_in(folder)
        files = dict.fromkeys((*before.files, *_storable(trial).files))
        if len(files) > len(before.files):
            content = replace(before, files=[*files])
            private(folder / TRIAL, trial_format().dump_json(content, indent=1, exclude={"trace"}))


def private(path: Path, content: str | bytes) -> Path:
    """Write a file that only its owner may read: completely, or not at all."""
    return write_whole(path, content.encode() if isinstance(content, str) else content, mode=0o600)


def _storable(trial: Trial) -> Trial:
    """The trial with absolute paths, and without missing numbers."""
    files = [each._replace(path=each.path.absolute()) for each in trial.files]
    return replace(trial, files=files, measures=[each for each in trial.measures if math.isfinite(each[1])])


def _agreed(file: Path, facts: Mapping[str, Any], who: str) -> dict[str, Any]:
    """Content of a file together with new facts.

    Raises
    ------
    ConfigurationError : a fact contradicts the file.
    """
    known = content_of(file)
    for name, value in facts.items():
        if value is not None and known.setdefault(name, value) != value:
            raise ConfigurationError(name, value, f"{known[name]}, as the study has it for {who}")
    return known


def _table(columns: Mapping[str, Any]) -> bytes:
    """Samples as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        zip(*(getattr(each, "tolist", lambda each=each: each)() for each in columns.values()), strict=True)
    )
    return text.getvalue().encode()
