"""How a command of `rehab-opt` says whose trial it makes: --study FILE --person P --session S --covariate KEY=VALUE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.trial import Session, Trial, checked_label

__all__ = [
    "COVARIATES",
    "CovariateOption",
    "Covariates",
    "Destination",
    "PersonOption",
    "SessionOption",
    "StudyOption",
    "covariates",
    "covariates_of",
    "destination",
]

StudyOption = Annotated[Path | None, typer.Option("--study", metavar="FILE", help="Study that the trials go into.")]
PersonOption = Annotated[str | None, typer.Option("--person", help="Pseudonym of the person, with --study.")]
SessionOption = Annotated[str | None, typer.Option("--session", help="Name of the session, with --study.")]
CovariateOption = Annotated[
    list[str] | None,
    typer.Option("--covariate", metavar="KEY=VALUE", help="With --study: group, condition, visit or date, one each."),
]
COVARIATES = ("group", "condition", "visit", "date")


@dataclass(frozen=True)
class Covariates:
    """What is known of a trial beside its numbers; see `Session` and `Trial`."""

    group: str | None = None
    condition: str | None = None
    visit: int | None = None
    date: str | None = None

    def session(self, person: str | None, name: str | None) -> Session:
        """The session of a person.

        Raises
        ------
        ConfigurationError : nobody, no name, or labels that a `Session` refuses.
        """
        for option, value in (("--person", person), ("--session", name)):
            if value is None:
                raise ConfigurationError(option, None, "this option, with --study")
        return Session(str(person), str(name), group=self.group, visit=self.visit, date=self.date)


@dataclass(frozen=True)
class Destination:
    """Where the trials of a command go: a session of a study, and the condition under which they were done."""

    file: Path
    session: Session
    condition: str | None

    def add(self, trials: Sequence[Trial]) -> int:
        """Write the trials in one commit; how many were new. Raises as `Study.add`."""
        from rehab_opt.study.store import Study  # noqa: PLC0415

        said = [trial if self.condition is None else trial.under(self.condition) for trial in trials]
        with Study(self.file) as study:
            return study.add(self.session, said)

    def check(self) -> None:
        """The file can be written to, and what is stated of the person agrees with it. Raises as `Study.check`."""
        from rehab_opt.study.store import Study  # noqa: PLC0415

        with Study(self.file) as study:
            study.check(self.session)

    def said(self, new: int) -> str:
        """What became of the trials, in a line."""
        trials = "1 trial" if new == 1 else f"{new} trials"
        from rehab_opt.study.parquet import kept_as_parquet  # noqa: PLC0415

        kept = "" if new else " (the study has them already)"
        kept += "" if kept_as_parquet() else " (without samples: pip install 'rehab_opt[parquet]' keeps them, too)"
        return f"{trials} into {self.file}: {self.session.person}, {self.session.name}{kept}"


def destination(
    study: Path | None, person: str | None, session: str | None, said: Sequence[str] | None
) -> Destination | None:
    """Where trials go, checked before anything is computed; None without a study.

    Raises
    ------
    ConfigurationError : no study where the other options need one; as `covariates`, `Covariates.session` and `Study`.
    """
    if study is None:
        for option, value in (("--person", person), ("--session", session), ("--covariate", said or None)):
            if value is not None:
                raise ConfigurationError(option, value, "no such option without --study FILE")
        return None
    given = covariates(said)
    place = Destination(study, given.session(person, session), given.condition)
    place.check()
    return place


def covariates(said: Sequence[str] | None) -> Covariates:
    """Covariates as options say them, `key=value` each.

    Raises
    ------
    ConfigurationError : another key, one twice, a visit that is no number.
    """
    given: dict[str, str] = {}
    for each in said or ():
        key, equals, value = (part.strip() for part in each.partition("="))
        if not equals or key not in COVARIATES or key in given:
            raise ConfigurationError("--covariate", each, f"KEY=VALUE, KEY one of {', '.join(COVARIATES)}, each once")
        given[key] = value
    return covariates_of(given)


def covariates_of(given: Mapping[str, str]) -> Covariates:
    """Covariates from texts by their names; empty ones are none.

    Raises
    ------
    ConfigurationError : a visit that is no number, labels that a `Session` or a `Trial` refuses.
    """
    there = {key: value for key, value in given.items() if value}
    visit = there.pop("visit", None)
    if visit is not None and not (visit.isascii() and visit.isdecimal() and len(visit) < 6):
        raise ConfigurationError("visit", visit, "a number, 0 or more")
    if "condition" in there:
        checked_label("condition", there["condition"])
    return Covariates(visit=None if visit is None else int(visit), **there)
