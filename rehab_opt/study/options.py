"""Command-line options for storing trials in a study: --study FOLDER --person P --session S --covariate KEY=VALUE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.trial import Session, Trial, checked_label

__all__ = [
    "CovariateOption",
    "Destination",
    "PersonOption",
    "SessionOption",
    "StudyOption",
    "destination",
    "session_of",
]

StudyOption = Annotated[Path | None, typer.Option("--study", metavar="FOLDER", help="Study to store the trials in.")]
PersonOption = Annotated[str | None, typer.Option("--person", help="Pseudonym of the person, with --study.")]
SessionOption = Annotated[str | None, typer.Option("--session", help="Name of the session, with --study.")]
CovariateOption = Annotated[
    list[str] | None,
    typer.Option("--covariate", metavar="KEY=VALUE", help="With --study: group, condition, visit or date, one each."),
]
COVARIATES = ("group", "condition", "visit", "date")


@dataclass(frozen=True)
class Destination:
    """Place where a command stores its trials: the study's folder, the session, and the condition of the trials."""

    folder: Path
    session: Session
    condition: str | None

    def add(self, trials: Sequence[Trial]) -> int:
        """Store the trials and return the number of new ones; raises as `Study.add`."""
        from rehab_opt.study.store import Study  # noqa: PLC0415

        with Study(self.folder) as study:
            return study.add(self.session, [each.under(self.condition) for each in trials])

    def written(self, new: int) -> str:
        """One line that reports the number of stored trials."""
        there = "" if new else " (the study has them already)"
        trials = "1 trial" if new == 1 else f"{new} trials"
        return f"{trials} into {self.folder}: {self.session.person}, {self.session.name}{there}"


def destination(
    study: Path | None, person: str | None, session: str | None, covariate: Sequence[str] | None
) -> Destination | None:
    """Place where a command will store its trials, checked before any computation; None without a study.

    Raises
    ------
    ConfigurationError : an option needs a study, a covariate is unknown, repeated or contradicts the study, or
        `session_of` or `Study` raises the error.
    """
    if study is None:
        for option, value in (("--person", person), ("--session", session), ("--covariate", covariate or None)):
            if value is not None:
                raise ConfigurationError(option, value, "no such option without --study FOLDER")
        return None
    given: dict[str, str] = {}
    for each in covariate or ():
        key, equals, value = (part.strip() for part in each.partition("="))
        if not equals or key not in COVARIATES or key in given:
            raise ConfigurationError("--covariate", each, f"KEY=VALUE, KEY one of {', '.join(COVARIATES)}, each once")
        given[key] = value
    place = Destination(study, *session_of(person, session, given))
    from rehab_opt.study.store import Study  # noqa: PLC0415

    with Study(study) as opened:
        opened.check(place.session)
    return place


def session_of(person: str | None, name: str | None, covariates: Mapping[str, str]) -> tuple[Session, str | None]:
    """Two results: the session and the condition that the texts describe; an empty covariate means none.

    Raises
    ------
    ConfigurationError : the person or the session is missing, the visit is not a number, or a label is invalid for
        `Session` or `Trial`.
    """
    for option, value in (("--person", person), ("--session", name)):
        if value is None:
            raise ConfigurationError(option, None, "this option, with --study")
    group, condition, visit, date = (covariates.get(key) or None for key in COVARIATES)
    if visit is not None and not (visit.isascii() and visit.isdecimal() and len(visit) < 6):
        raise ConfigurationError("visit", visit, "a number, 0 or more")
    if condition is not None:
        checked_label("condition", condition)
    return Session(str(person), str(name), group, None if visit is None else int(visit), date), condition
