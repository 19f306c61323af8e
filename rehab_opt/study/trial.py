"""What a study keeps of a trial, and of the session that it belongs to."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.score import Measure
from rehab_opt.text_file import is_formula, shown

__all__ = ["DONE", "Bound", "Event", "ProblemText", "Session", "StoredFile", "Trial", "checked_label"]

DONE = "done"
LONGEST_LABEL = 100
MAX_VISIT = 10_000


class Bound(NamedTuple):
    """A limit of a trial, and what came nearest to it; both in `unit`."""

    name: str
    value: float
    bound: float
    unit: str


class Event(NamedTuple):
    """Something of safety that happened: what, and how many times, counted in `unit`."""

    text: str
    times: float
    unit: str = "ticks"


class StoredFile(NamedTuple):
    """A file of a trial. Of kind "recording" it is somebody else's; others were written by this library."""

    path: Path
    kind: str = "trace"


class ProblemText(NamedTuple):
    """A problem as it was run: TOML as the file has it, or JSON of what a row of a table made of it."""

    name: str
    text: str


@dataclass(frozen=True)
class Session:
    """One visit of one person.

    Parameters
    ----------
    person : pseudonym such as "P01", without blanks, commas or @: a study holds no names and no addresses.
    name : of the session, unique for the person.
    group : of the person, such as "stroke".
    visit : its number, 0 or more.
    date : ISO, such as 2026-11-23.

    Raises
    ------
    ConfigurationError : a label that `checked_label` refuses, a person that looks like a name, no visit, no date.
    """

    person: str
    name: str
    group: str | None = None
    visit: int | None = None
    date: str | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be kept."""
        if any(each.isspace() or each in ",@" for each in checked_label("person", self.person)):
            expected = "a pseudonym such as P01, without blanks, commas or @: names stay outside of a study"
            raise ConfigurationError("person", shown(self.person), expected)
        checked_label("session", self.name)
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
    """A finished trial; a study keeps all of it or none.

    Parameters
    ----------
    kind : what made it: "run", "many", "score" or "live".
    measures : numbers with their units; NaN where there is none.
    condition : under which it was done, such as "assisted".
    digest : of everything it depends on: a session has a trial of one digest once. None for what happens once.
    status : "done", or why `error` says it is not.
    seconds : what computing it took [s].
    problem, software : as it was run, and with which versions.
    trace : samples, of which the study keeps a copy as Parquet (with pyarrow): a .csv, or columns (N,) by name.
    files : that belong to the trial, and stay where they lie.
    outline : closed polygon (N, 2) [m] of the ground that the hand covered.
    """

    kind: str
    measures: Sequence[Measure] = ()
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
        """Refuse a condition that is no label, and what no report could say: numbers that are not finite."""
        if self.condition is not None:
            checked_label("condition", self.condition)
        said = [(f"bound {each.name}", number) for each in self.bounds for number in (each.value, each.bound)]
        said += [(f"event {each.text}", each.times) for each in self.events]
        for what, number in (*said, ("seconds", 0.0 if self.seconds is None else self.seconds)):
            if not isinstance(number, float | int | np.floating | np.integer) or not math.isfinite(number):
                raise ConfigurationError(what, number, "a finite number")

    def under(self, condition: str) -> Trial:
        """The trial under a condition, which comes before the one that it has, such as a controller."""
        return replace(self, condition=condition if self.condition is None else f"{condition}, {self.condition}")


def checked_label(argument: str, label: str) -> str:
    """A pseudonym, session, group or condition.

    Raises
    ------
    ConfigurationError : no text, empty, longer than 100 characters, not printable, with blanks at an end, or what a
        spreadsheet would compute: these go into tables.
    """
    ok = isinstance(label, str) and 0 < len(label) <= LONGEST_LABEL and not is_formula(label)
    if not (ok and label.isprintable() and label == label.strip()):
        expected = f"1 to {LONGEST_LABEL} printable characters, no blanks at either end, no formula (=, +, -, @ first)"
        raise ConfigurationError(argument, shown(str(label)), expected)
    return label
