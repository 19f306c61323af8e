"""Batch runs: run the problem of each person and write a row for each; people do not affect one another."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from rehab_opt.errors import ConfigurationError, RehabOptError, printable
from rehab_opt.session.inputs import inputs_digest
from rehab_opt.session.many.participant import Participant, PersonResult, work_on
from rehab_opt.session.many.pools import answers
from rehab_opt.session.many.results import (
    FAILED,
    NOT_RUN,
    REFUSED,
    ResultRow,
    forget,
    keep,
    kept_row,
    write_groups,
    write_parquet,
    write_rows,
)
from rehab_opt.session.outcome import Progress
from rehab_opt.text_file import shown

RESULTS, PARQUET, GROUPS = "results.csv", "results.parquet", "groups.csv"
LONGEST_ERROR = 400


def run_many(
    participants: Sequence[Participant],
    *,
    out: Path,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress = lambda *_: None,
    work: Callable[[Participant], PersonResult] = work_on,
    timeout_s: float | None = None,
    record: Callable[[Participant, ResultRow, Path, str], None] = lambda *_: None,
) -> tuple[ResultRow, ...]:
    """Run the problem of each person; write a folder for each person, results.csv with a row for each, and groups.csv.

    With pyarrow (extra `parquet`), results.parquet has the same rows with typed columns.

    results.csv is updated about once a second. Existing results with the same problem, recordings and software are
    kept, so an interrupted batch can be continued by another call.

        with distributed.Client(...) as client:
            run_many(participants_of(Path("people.csv")), out=Path("out"), executor=client.get_executor())

    Parameters
    ----------
    participants : people from `participants_of`, with distinct names.
    out : folder of the results.
    executor : any `concurrent.futures.Executor`, such as that of a dask.distributed client; its workers need rehab_opt
        and the recordings, and write no files. By default, each core runs one process at a time; if a process dies,
        only its own person fails.
    workers : number of processes, by default one for each core. With an executor, number of people that are given to
        the executor at once, by default 256.
    progress : callback for the number of finished people.
    work : function that computes the result of one person; other processes must be able to import it by name.
    timeout_s : time [s] after which a person's process is killed, without an executor.
    record : function that is called for each finished person with the person, the row, the folder of the result and
        the digest of the inputs.

    Returns
    -------
    One row for each person, in the order of `participants`.

    Raises
    ------
    ConfigurationError : there are no people, two have the same name, there is less than 1 worker, or the folder cannot
        be written to.
    RehabOptError : no problem is valid; the error is that of the first problem, and no file is written.
    """
    names = [person.name for person in participants]
    if not names or len(set(names)) < len(names):
        raise ConfigurationError("participants", shown(", ".join(names)), "one at least, each with a name of its own")
    if workers is not None and not workers >= 1:
        raise ConfigurationError("--workers", workers, "a number of processes, 1 or more")
    if timeout_s is not None and (executor is not None or not 0 < timeout_s < math.inf):
        raise ConfigurationError("--timeout", timeout_s, "seconds above zero, and processes of this machine")
    rows: dict[str, ResultRow] = {}
    digests: dict[str, str] = {}
    first: RehabOptError | None = None
    for person in participants:
        try:
            digests[person.name] = _digest(person)
        except RehabOptError as refused:
            first = first or refused
            rows[person.name] = ResultRow(person.name, REFUSED, _one_line(refused))
    if first is not None and len(rows) == len(names):
        raise first
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in rows:
            with suppress(OSError):  # a path that is not a folder has no result to remove
                forget(out / name)

        def table(why: str) -> tuple[ResultRow, ...]:
            said = (rows.get(each.name, ResultRow(each.name, NOT_RUN, why)) for each in participants)
            pairs = zip(said, participants, strict=True)
            return tuple(replace(row, inputs=each.inputs, covariates=each.covariates) for row, each in pairs)

        write = _Sometimes(lambda: write_rows(table("not done yet"), out / RESULTS))
        try:
            for person in participants:
                digest = digests.get(person.name)
                kept = None if digest is None else kept_row(person.name, out / person.name, digest)
                if digest is not None and kept is not None:
                    rows[person.name] = kept
                    record(person, kept, out / person.name, digest)
            left = [person for person in participants if person.name not in rows]
            progress("participants", len(rows), len(names))
            for person, answer in answers(left, work, executor=executor, workers=workers, timeout_s=timeout_s):
                digest = digests[person.name]
                rows[person.name] = _row(person.name, answer, out / person.name, digest)
                record(person, rows[person.name], out / person.name, digest)
                write.now_and_then()
                progress("participants", len(rows), len(names))
        finally:
            ordered = table("interrupted before it was done")
            write_rows(ordered, out / RESULTS)
            write_parquet(ordered, out / PARQUET)
            write_groups(ordered, out / GROUPS)
    except OSError as problem:
        expected = f"a folder that can be written to ({problem.strerror})"
        raise ConfigurationError("--out", str(out), expected) from problem
    return ordered


class _Sometimes:
    """Calls a function at most once a second and for at most 5 % of the time."""

    def __init__(self, do: Callable[[], None]) -> None:
        self._do = do
        self._next = 0.0

    def now_and_then(self) -> None:
        began = time.monotonic()
        if began >= self._next:
            self._do()
            took = time.monotonic() - began
            self._next = began + max(1.0, 20 * took)


def _digest(person: Participant) -> str:
    if person.error:
        raise UnusableParticipantError(person.error)
    return inputs_digest(person.problem())


class UnusableParticipantError(RehabOptError):
    """A row or problem file of a batch is invalid; the message has the reason."""


def _row(name: str, answer: PersonResult | BaseException, folder: Path, digest: str) -> ResultRow:
    """Store a person's answer and return the row; if writing fails, the person's status is FAILED."""
    try:
        if isinstance(answer, PersonResult):
            return keep(name, answer, folder, digest)
        forget(folder)
    except OSError as problem:
        return ResultRow(name, FAILED, f"{folder} cannot be written to: {problem.strerror}")
    return ResultRow(name, REFUSED if isinstance(answer, RehabOptError) else FAILED, _one_line(answer))


def _one_line(problem: BaseException) -> str:
    said = str(problem) if isinstance(problem, RehabOptError) else f"{type(problem).__name__}: {problem}"
    return shown(printable(" ".join(said.splitlines())), LONGEST_ERROR)
