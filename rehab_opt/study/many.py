"""Store the results of a batch in a study; a person whose covariates contradict the study gets an error."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.session.many.participant import Participant
from rehab_opt.session.many.results import DONE, ResultRow
from rehab_opt.session.report import METRICS
from rehab_opt.study.options import session_of
from rehab_opt.study.record import metric_trials, versions
from rehab_opt.study.store import Study
from rehab_opt.study.trial import ProblemText, Session, StoredFile, Trial

__all__ = ["Recorder", "study_of_many"]


class Recorder:
    """Stores the results of a batch in a study; `run_many` calls the object with each finished row.

    Parameters
    ----------
    study : an open study.
    session : name of the session, for people whose row has none.
    table : path of the batch's results.csv.
    """

    def __init__(self, study: Study, session: str | None, *, table: Path) -> None:
        self._study, self._session, self._table = study, session, table

    def checked(self, people: Sequence[Participant]) -> list[Participant]:
        """The people, with an error for each person whose row contradicts the study."""
        errors: dict[str, RehabOptError] = {}
        sessions: dict[str, Session] = {}
        for person in people:
            if not person.error:
                try:
                    sessions[person.name] = self._place(person)[0]
                except RehabOptError as refused:
                    errors[person.name] = refused
        for name, refusal in zip(sessions, self._study.admit(sessions.values()), strict=True):
            errors |= {} if refusal is None else {name: refusal}
        return [
            replace(each, error=f"{each.file}: {errors[each.name]}") if each.name in errors else each for each in people
        ]

    def __call__(self, person: Participant, row: ResultRow, folder: Path, digest: str) -> None:
        """Store a row as trials; a result that is already in the study stays unchanged.

        Raises
        ------
        ConfigurationError : the study cannot be written to.
        """
        session, condition = self._place(person)
        problem = ProblemText(person.file, json.dumps(dict(person.content), sort_keys=True))
        trial = Trial(
            "many", digest=digest, status=row.status, error=row.error, seconds=row.seconds, problem=problem,
            software=versions(), files=[StoredFile(self._table, "table")],
        )  # fmt: skip
        trials: Sequence[Trial] = [trial]
        if row.status == DONE:
            metrics = json.loads((folder / METRICS).read_text(encoding="utf-8"))["metrics"]
            trials = metric_trials(metrics, trial, files=sorted(folder.iterdir()))
        self._study.add(session, [each.under(condition) for each in trials])

    def _place(self, person: Participant) -> tuple[Session, str | None]:
        session = person.covariates.get("session") or self._session
        if session is None:
            raise ConfigurationError("--session", None, "this option, or a column session, with --study")
        return session_of(person.name, session, person.covariates)


def study_of_many(opened: ExitStack, folder: Path | None, session: str | None, *, table: Path) -> Recorder | None:
    """Open the study in `folder` and return its recorder; None if `folder` is None. `opened` closes the study.

    Raises
    ------
    ConfigurationError : there is a session but no study, or the study cannot be opened.
    """
    if folder is None:
        if session is not None:
            raise ConfigurationError("--session", session, "no such option without --study FOLDER")
        return None
    return Recorder(opened.enter_context(Study(folder)), session, table=table)
