"""Data of a trial and of a session in a study."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

from rehab_opt.errors import ConfigurationError
from rehab_opt.text_file import is_formula, shown

__all__ = ["DONE", "Bound", "Event", "ProblemText", "Session", "StoredFile", "Trial", "checked_label"]

DONE = "done"
LONGEST_LABEL, LONGEST_FOLDER = 100, 200
"""Largest number of characters of a label, and largest number of bytes of a label that names a folder."""
MAX_VISIT = 10_000
FORBIDDEN = frozenset('/\\:*?"<>|')
OWN = frozenset({"study.json", "index.db", "index.db-journal"})


class Bound(NamedTuple):
    """A bound of a trial and the value that came closest to it, both in `unit`."""

    name: str
    value: float
    bound: float
    unit: str


class Event(NamedTuple):
    """A safety event of a trial: kind, and count in `unit`."""

    text: str
    times: float
    unit: str = "ticks"


class StoredFile(NamedTuple):
    """A file outside the study that contains data of a trial.

    If the person is removed from the study, a "result" is deleted, a "recording" stays, and a "table" loses the
    person's row.
    """

    path: Path
    kind: str = "result"


class ProblemText(NamedTuple):
    """Name and text of a problem as it was run: TOML of a file, or JSON of a table's row."""

    name: str
    text: str


@dataclass(frozen=True)
class Session:
    """One session of one person; the study has a folder for the person, and in it a folder for the session.

    Parameters
    ----------
    person : pseudonym such as "P01", without blanks, commas or @, so that it is not a real name or an address.
    name : name of the session, unique for the person.
    group : group of the person, such as "stroke".
    visit : number of the visit, 0 or more.
    date : date in ISO format, such as 2026-11-23.

    Raises
    ------
    ConfigurationError : a label is invalid or cannot name a folder, the pseudonym looks like a real name, or the visit
        or the date is invalid.
    """

    person: str
    name: str
    group: str | None = None
    visit: int | None = None
    date: str | None = None

    def __post_init__(self) -> None:
        for argument, label in (("person", self.person), ("session", self.name)):
            bad = FORBIDDEN & set(checked_label(argument, label)) or label[0] == "." or label[-1] == "." or label in OWN
            if bad or len(label.encode()) > LONGEST_FOLDER:
                raise ConfigurationError(argument, shown(label), "a label that a folder can have, no dot at either end")
        if any(each.isspace() or each in ",@" for each in self.person):
            expected = "a pseudonym such as P01, without blanks, commas or @: names stay outside of a study"
            raise ConfigurationError("person", shown(self.person), expected)
        if self.group is not None:
            checked_label("group", self.group)
        if self.visit is not None and not (type(self.visit) is int and 0 <= self.visit <= MAX_VISIT):
            raise ConfigurationError("visit", self.visit, f"a whole number from 0 to {MAX_VISIT}")
        if self.date is not None:
            try:
                ok = datetime.date.fromisoformat(self.date).isoformat() == self.date
            except (TypeError, ValueError):
                ok = False
            if not ok:
                raise ConfigurationError("date", shown(str(self.date)), "a day such as 2026-11-23")


@dataclass(frozen=True)
class Trial:
    """A trial with its measures, inputs and samples.

    Parameters
    ----------
    kind : source of the trial: "run", "many", "score" or "live".
    measures : measures, each with name, number and unit; numbers that are not finite are not stored.
    condition : condition of the trial, such as "assisted".
    digest : digest of all inputs; a session stores each digest once. None for a trial that cannot be repeated.
    status : "done", or another status with a reason in `error`.
    seconds : computing time [s]. notes : notes of the run.
    problem, software : the problem of the run, and the versions of the software.
    trace : samples, which the study copies: path of a .csv file, or columns (N,) by name.
    files : files outside the study; a metrics.json among them is copied, too.
    bounds, events : bounds with the values that came closest to them, and safety events.
    outline : corners (N, 2) [m] of the area that the hand covered.
    """

    kind: str
    measures: Sequence[tuple[str, float, str]] = ()
    condition: str | None = None
    digest: str | None = None
    status: str = DONE
    error: str = ""
    seconds: float | None = None
    notes: Sequence[str] = ()
    problem: ProblemText | None = None
    software: str | None = None
    trace: Path | Mapping[str, Any] | None = None
    files: Sequence[StoredFile] = ()
    bounds: Sequence[Bound] = ()
    events: Sequence[Event] = ()
    outline: Sequence[tuple[float, float]] = ()

    def __post_init__(self) -> None:
        """Check the condition, that each measure occurs once, and that bounds and events have finite numbers."""
        if self.condition is not None:
            checked_label("condition", self.condition)
        names = [(name, unit) for name, _, unit in self.measures]
        if len(set(names)) < len(names):
            raise ConfigurationError("measures", shown(str(names)), "each measure once")
        numbers = [(f"bound {each.name}", number) for each in self.bounds for number in (each.value, each.bound)]
        numbers += [(f"event {each.text}", each.times) for each in self.events]
        for what, number in (*numbers, ("seconds", 0.0 if self.seconds is None else self.seconds)):
            if not isinstance(number, Real) or not math.isfinite(number):
                raise ConfigurationError(what, number, "a finite number")

    def under(self, condition: str | None) -> Trial:
        """The trial with `condition` in front of its own condition, separated by a comma; unchanged for None."""
        return replace(self, condition=", ".join(filter(None, (condition, self.condition))) or None)


def checked_label(argument: str, label: str) -> str:
    """Check a pseudonym, session, group or condition and return it.

    Raises
    ------
    ConfigurationError : the label is not a text, is empty, has more than 100 characters, is not printable, has blanks
        at an end, or would be a formula in a spreadsheet.
    """
    ok = isinstance(label, str) and 0 < len(label) <= LONGEST_LABEL and not is_formula(label)
    if not (ok and label.isprintable() and label == label.strip()):
        expected = f"1 to {LONGEST_LABEL} printable characters, no blanks at either end, no formula (=, +, -, @ first)"
        raise ConfigurationError(argument, shown(str(label)), expected)
    return label
