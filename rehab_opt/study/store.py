"""A study is a folder of trials; several processes can write trials at the same time, and queries use an index.

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
    folder : folder of the study; only its owner gets access.
    create : whether a missing folder is created.

    Raises
    ------
    ConfigurationError : the folder is not a study, or cannot be read.
    """

    def __init__(self, folder: str | Path, *, create: bool = True) -> None:
        folder = Path(folder)
        mark = folder / MARK
        try:
            if create and not mark.exists() and not (folder.exists() and any(folder.iterdir())):
                folder.mkdir(parents=True, exist_ok=True, mode=0o700)
                with suppress(FileExistsError), mark.open("x", encoding="utf-8") as made:  # may race another process
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
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close the index."""
        self.close()

    def close(self) -> None:
        """Close the index."""
        self.db.close()

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Context in which no other process writes to the study.

        Raises
        ------
        ConfigurationError : the folder cannot be written to.
        """
        with self.refusals(), self.transaction():
            yield

    def add(self, session: Session, trials: Trial | Sequence[Trial]) -> int:
        """Store trials in a session and return the number of new trials.

        If the session has a finished trial with the same digest, the trial is not stored again. A failed trial with the
        same digest is replaced. Group, visit and date that are None here stay as they are in the study.

        Raises
        ------
        ConfigurationError : group, visit or date differ from those in the study, or the folder cannot be written to.
        """
        new, copies = 0, dict[int, Path]()  # trials with the same trace share one file on the disk
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
        """Raise the errors that `add` would raise for a session, without writing."""
        with self.writing():
            _agreed(self.folder / session.person / PERSON, {"group": session.group}, session.person)
            dated = {"visit": session.visit, "date": session.date}
            _agreed(self.folder / session.person / session.name / SESSION, dated, session.name)

    def admit(self, sessions: Iterable[Session]) -> list[ConfigurationError | None]:
        """Create the folders of sessions; return for each session None, or the error if it contradicts the study."""
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
        """Create the folder of a session, with the files that describe person and session."""
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
        """Write a trial's folder with the next free number; the folder has a temporary name until it is complete."""
        shutil.rmtree(home / PARTIAL, ignore_errors=True)  # left by a killed process
        numbers = [int(each) for each in os.listdir(home) if each.isascii() and each.isdecimal()]
        scratch, target = home / PARTIAL, home / f"{1 + max(numbers, default=0):03}"
        scratch.mkdir()
        samples = {METRICS: next((each.path for each in trial.files if each.path.name == METRICS), None),
                   "trace.csv": trial.trace}  # fmt: skip
        for name, source in samples.items():
            if source is not None and id(source) in copies:
                try:
                    os.link(copies[id(source)], scratch / name)
                except OSError:  # the file system has no hard links
                    shutil.copyfile(copies[id(source)], scratch / name)
            elif source is not None:
                private(scratch / name, source.read_bytes() if isinstance(source, Path) else _table(source))
                copies[id(source)] = target / name
        private(scratch / TRIAL, trial_format().dump_json(_storable(trial), indent=1, exclude={"trace"}))
        scratch.rename(target)
        if os.name == "posix":  # makes the new name survive a power failure
            at = os.open(home, os.O_RDONLY)
            os.fsync(at)
            os.close(at)

    def _known_by(self, trial: Trial, folder: Path) -> None:
        """Add files outside the study to an existing trial, so that they are removed with the person."""
        (before,) = trials_in(folder)
        files = dict.fromkeys((*before.files, *_storable(trial).files))
        if len(files) > len(before.files):
            content = replace(before, files=[*files])
            private(folder / TRIAL, trial_format().dump_json(content, indent=1, exclude={"trace"}))


def private(path: Path, content: str | bytes) -> Path:
    """Write a file that only its owner may read, either completely or not at all."""
    return write_whole(path, content.encode() if isinstance(content, str) else content, mode=0o600)


def _storable(trial: Trial) -> Trial:
    """The trial with absolute paths, and without measures that are not finite."""
    files = [each._replace(path=each.path.absolute()) for each in trial.files]
    return replace(trial, files=files, measures=[each for each in trial.measures if math.isfinite(each[1])])


def _agreed(file: Path, facts: Mapping[str, Any], who: str) -> dict[str, Any]:
    """Content of a JSON file with new facts added; raises ConfigurationError if a fact contradicts the file."""
    known = content_of(file)
    for name, value in facts.items():
        if value is not None and known.setdefault(name, value) != value:
            raise ConfigurationError(name, value, f"{known[name]}, as the study has it for {who}")
    return known


def _table(columns: Mapping[str, Any]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        zip(*(getattr(each, "tolist", lambda each=each: each)() for each in columns.values()), strict=True)
    )
    return text.getvalue().encode()
