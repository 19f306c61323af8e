"""Many people's problems at once, each with a row of its own whatever becomes of the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from pathlib import Path

from rehab_opt.errors import ConfigurationError, RehabOptError, printable
from rehab_opt.session.many.digest import inputs_digest
from rehab_opt.session.many.participant import Participant
from rehab_opt.session.many.pools import answers
from rehab_opt.session.many.results import FAILED, NOT_RUN, REFUSED, Row, forget, keep, kept_row, write_rows
from rehab_opt.session.many.work import Answer, work_on
from rehab_opt.session.outcome import Progress
from rehab_opt.text_file import shown

__all__ = ["RESULTS", "run_many"]

RESULTS = "results.csv"
LONGEST_ERROR = 400


def run_many(
    participants: Sequence[Participant],
    *,
    out: Path,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress = lambda *_: None,
    work: Callable[[Participant], Answer] = work_on,
) -> tuple[Row, ...]:
    """Run every person's problem; write a folder for each, and results.csv with a row for each.

    A result that is there already, of the same problem, recordings and software, is kept. Interrupted, it leaves what
    is done, and results.csv; called again, it does the rest.

        with distributed.Client(...) as client:
            run_many(participants_of(Path("people.csv")), out=Path("out"), executor=client.get_executor())

    Parameters
    ----------
    participants : from `participants_of`, names differing.
    out : folder of the results.
    executor : any `concurrent.futures.Executor`, such as a dask.distributed client's; its workers need this library
        and the recordings, and write nothing. By default a process for each core; one that dies fails its own person
        alone.
    workers : processes where no executor is given.
    progress : told how many are done.
    work : what is done for one person; importable by name, for other processes.

    Returns
    -------
    A row for each person, in their order.

    Raises
    ------
    ConfigurationError : nobody, two of one name, a number of workers below 1, a folder that cannot be written to.
    RehabOptError : nobody's problem can be used; the first one's refusal, and nothing is written.
    """
    names = [person.name for person in participants]
    if not names or len(set(names)) < len(names):
        raise ConfigurationError("participants", shown(", ".join(names)), "one at least, each with a name of its own")
    if workers is not None and not workers >= 1:
        raise ConfigurationError("--workers", workers, "a number of processes, 1 or more")
    rows: dict[str, Row] = {}
    digests: dict[str, str] = {}
    first: RehabOptError | None = None
    for person in participants:
        try:
            digests[person.name] = _digest(person)
        except RehabOptError as refused:
            first = first or refused
            rows[person.name] = Row(person.name, REFUSED, _one_line(refused))
    if first is not None and len(rows) == len(names):
        raise first
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in rows:
            with suppress(OSError):  # what is no folder of ours holds no result of ours
                forget(out / name)
        for name, digest in digests.items():
            kept = kept_row(name, out / name, digest)
            if kept is not None:
                rows[name] = kept
        left = [person for person in participants if person.name not in rows]
        progress("participants", len(rows), len(names))
        try:
            for person, answer in answers(left, work, executor=executor, workers=workers):
                rows[person.name] = _row(person.name, answer, out / person.name, digests[person.name])
                progress("participants", len(rows), len(names))
        finally:
            ordered = tuple(rows.get(name, Row(name, NOT_RUN, "interrupted before it was done")) for name in names)
            write_rows(ordered, out / RESULTS)
    except OSError as problem:
        expected = f"a folder that can be written to ({problem.strerror})"
        raise ConfigurationError("--out", str(out), expected) from problem
    return ordered


def _digest(person: Participant) -> str:
    if person.error:
        raise UnusableParticipantError(person.error)
    return inputs_digest(person.problem())


class UnusableParticipantError(RehabOptError):
    """A row or a file was refused when it was read; the message is that refusal."""


def _row(name: str, answer: Answer | BaseException, folder: Path, digest: str) -> Row:
    """The row of an answer, which is kept; what cannot be written is one person's failure."""
    try:
        if isinstance(answer, Answer):
            return keep(name, answer, folder, digest)
        forget(folder)
    except OSError as problem:
        return Row(name, FAILED, f"{folder} cannot be written to: {problem.strerror}")
    return Row(name, REFUSED if isinstance(answer, RehabOptError) else FAILED, _one_line(answer))


def _one_line(problem: BaseException) -> str:
    said = str(problem) if isinstance(problem, RehabOptError) else f"{type(problem).__name__}: {problem}"
    return shown(printable(" ".join(said.splitlines())), LONGEST_ERROR)
