"""Statistics of a study: sessions of each person, measures over sessions, extreme trials, distances to bounds."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple, TypeVar

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.store import Study
from rehab_opt.study.trial import DONE
from rehab_opt.text_file import shown

__all__ = [
    "Interval", "Quantity", "SessionMean", "bounds", "check_there", "events", "extreme", "ground", "grouped",
    "interval", "of_people", "overview", "people", "quantities", "quantity", "session_means", "sessions",
    "slopes", "stating_safety", "trend",
]  # fmt: skip

T = TypeVar("T")
FROM = "FROM sessions s JOIN trials t ON t.session = s.id"
IN_ORDER = "s.visit IS NULL, s.visit, s.date IS NULL, s.date, s.name"
"""Order of sessions: by visit, then date, then name."""


class Interval(NamedTuple):
    """Mean of `n` values with its 95 % confidence interval (Student's t); the interval of a single value is NaN."""

    mean: float
    lower: float
    upper: float
    n: int


class Quantity(NamedTuple):
    """A measure by name and unit; the unit is "" if the measure has none or the name includes it."""

    id: int
    name: str
    unit: str

    @property
    def label(self) -> str:
        """Name with the unit in brackets, if there is one."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


class SessionMean(NamedTuple):
    """Mean of a measure over the trials of one session under one condition.

    `order` is the session's number for the person, from 0; `values` are the values of the trials.
    """

    person: str
    group: str | None
    session: str
    date: str | None
    order: int
    condition: str | None
    mean: float
    values: Sequence[float]


def interval(values: Sequence[float]) -> Interval:
    """Mean of values with its 95 % confidence interval, for independent, normally distributed values."""
    n = len(values)
    mean = math.fsum(values) / n if n else math.nan
    # hypot does not overflow for very large values
    spread = math.hypot(*(value - mean for value in values)) / math.sqrt((n - 1) * n) if n > 1 else math.nan
    return _within(mean, spread, n - 1, n)


def trend(means: Sequence[float]) -> Interval:
    """Slope of the least-squares line through at least three equally spaced values, with its 95 % interval."""
    n, slope = len(means), _slope(range(len(means)), means)
    x, y = (n - 1) / 2, math.fsum(means) / n
    rest = math.hypot(*(value - y - slope * (i - x) for i, value in enumerate(means)))
    return _within(slope, rest / math.sqrt((n - 2) * math.fsum((i - x) ** 2 for i in range(n))), n - 2, n)


def _within(middle: float, spread: float, freedom: int, n: int) -> Interval:
    if freedom < 1:
        return Interval(middle, math.nan, math.nan, n)
    from scipy.special import stdtrit  # noqa: PLC0415

    half = float(stdtrit(freedom, 0.975)) * spread
    return Interval(middle, middle - half, middle + half, n)


def _slope(x: Sequence[int], y: Sequence[float]) -> float:
    """Slope of the least-squares line; NaN if all x are equal."""
    middle, mean = math.fsum(x) / len(x), math.fsum(y) / len(y)
    spread = math.fsum((each - middle) ** 2 for each in x)
    rise = math.fsum((each - middle) * (value - mean) for each, value in zip(x, y, strict=True))
    return rise / spread if spread > 0 else math.nan


def check_there(study: Study, person: str) -> None:
    """Check that a person is in the study.

    Raises
    ------
    ConfigurationError : the person is unknown.
    """
    if not study.rows("SELECT 1 FROM sessions WHERE person = ?", (person,)):
        raise ConfigurationError("--person", person, "somebody in this study (rehab-opt study list says who)")


def overview(study: Study) -> Any:
    """Numbers of people, sessions, trials and unfinished trials, first day and last day of a study."""
    counts = "count(DISTINCT person), count(*), (SELECT count(*) FROM trials), (SELECT count(*) FROM trials WHERE"
    return study.rows(f"SELECT {counts} status <> ?), min(date), max(date) FROM sessions", (DONE,))[0]


def people(study: Study, person: str | None = None) -> list[Any]:
    """Rows of all people sorted by name, or of one person: name, group, sessions, trials, last day."""
    of, who = _of_person(person)
    question = (
        'SELECT s.person, s."group", count(DISTINCT s.id), count(t.id), max(s.date) FROM sessions s '
        f"LEFT JOIN trials t ON t.session = s.id WHERE {of} GROUP BY s.person ORDER BY s.person"
    )
    return study.rows(question, who)


def quantities(study: Study, person: str | None = None) -> list[Quantity]:
    """Measures of all people or of one person, in order of first occurrence."""
    of, who = _of_person(person)
    measured = f"{FROM} JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity WHERE {of}"
    question = "FROM quantities q" if person is None else measured
    return [Quantity(*row) for row in study.rows(f"SELECT DISTINCT q.id, q.name, q.unit {question} ORDER BY q.id", who)]


def quantity(study: Study, name: str) -> Quantity:
    """The measure with a name, or with a name and unit such as "speed [m/s]".

    Raises
    ------
    ConfigurationError : there is no such measure, or there are several with this name and different units.
    """
    known = quantities(study)
    found = [each for each in known if name in (each.name, f"{each.name} [{each.unit}]")]
    if len(found) != 1:
        near = get_close_matches(name, [each.name for each in known]) or [each.name for each in known[:5]]
        names = [each.label for each in found] or near
        expected = f"a measure of this study, such as {', '.join(names)}" if names else "a study that has measures"
        raise ConfigurationError("--measure", shown(name), expected)
    return found[0]


def sessions(study: Study, person: str) -> list[Any]:
    """Rows of a person's sessions and conditions: name, visit, day, condition, trials, unfinished trials."""
    question = (
        "SELECT s.name, s.visit, s.date, t.condition, count(t.id), coalesce(sum(t.status <> ?1), 0) FROM sessions s "
        "LEFT JOIN trials t ON t.session = s.id "
        f"WHERE s.person = ?2 GROUP BY s.id, t.condition ORDER BY {IN_ORDER}, t.condition"
    )
    return study.rows(question, (DONE, person))


def session_means(
    study: Study,
    measures: Sequence[Quantity],
    person: str | None = None,
    ends: Callable[[Quantity], tuple[float, float]] = lambda _: (-math.inf, math.inf),
) -> dict[Quantity, list[SessionMean]]:
    """Means of measures over the trials of each session and condition, in the order of the sessions.

    Unfinished trials, and values outside the interval that `ends` returns for a measure, do not count. The
    `values` are empty unless `person` is stated.
    """
    of, who = _of_person(person)
    question = (
        f"WITH o AS (SELECT s.id, row_number() OVER (PARTITION BY s.person ORDER BY {IN_ORDER}) - 1 AS place "
        f'FROM sessions s) SELECT s.person, s."group", s.name, s.date, o.place, t.condition, avg(m.value), '
        f"{'NULL' if person is None else 'json_group_array(m.value)'} {FROM} JOIN o ON o.id = s.id "
        f"JOIN measures m ON m.trial = t.id WHERE {of} AND t.status = ? "
        "AND m.quantity = ? AND m.value BETWEEN ? AND ? GROUP BY s.id, t.condition"
    )
    found: dict[int, list[SessionMean]] = {each.id: [] for each in measures}
    for measure in measures:
        for *row, values in study.rows(question, (*who, DONE, measure.id, *ends(measure))):
            found[measure.id].append(SessionMean._make([*row, json.loads(values) if values else ()]))
    for means in found.values():
        means.sort(key=lambda each: (each.person, each.order, each.condition or ""))
    return {measure: found[measure.id] for measure in measures}


def _of_person(person: str | None) -> tuple[str, tuple[str, ...]]:
    """SQL condition that selects one person or all people; it avoids OR, which SQLite's indices do not support."""
    return ("1", ()) if person is None else ("s.person = ?", (person,))


def grouped(means: Iterable[SessionMean], key: Callable[[SessionMean], T]) -> dict[T, list[SessionMean]]:
    """Session means grouped and sorted by `key`."""
    found: dict[T, list[SessionMean]] = defaultdict(list)
    for each in means:
        found[key(each)].append(each)
    return dict(sorted(found.items()))


def of_people(means: Iterable[SessionMean]) -> dict[str, float]:
    """For each person, the mean over the person's sessions."""
    by_person = grouped(means, lambda each: each.person)
    return {person: math.fsum(each.mean for each in own) / len(own) for person, own in by_person.items()}


def slopes(means: Iterable[SessionMean]) -> dict[str, float]:
    """Each person's least-squares slope per session; people with a single session are left out."""
    by_person = grouped(means, lambda each: each.person)
    found = {
        person: _slope([each.order for each in own], [each.mean for each in own]) for person, own in by_person.items()
    }
    return {person: slope for person, slope in found.items() if not math.isnan(slope)}


def extreme(study: Study, measure: Quantity, ends: tuple[float, float], *, largest: bool, person: str | None) -> Any:
    """Finished trial with the largest or smallest value of a measure; values outside `ends` do not count.

    The row has person, session, day, number of the trial, condition and value; None without such a trial.
    """
    of, who = _of_person(person)
    question = (  # beside max or min, SQLite returns the other columns of the same row
        f"SELECT s.person, s.name, s.date, t.number, t.condition, {'max' if largest else 'min'}(m.value) {FROM} "
        f"JOIN measures m ON m.trial = t.id WHERE {of} AND m.quantity = ? AND t.status = ? AND m.value BETWEEN ? AND ?"
    )
    (row,) = study.rows(question, (*who, measure.id, DONE, *ends))
    return None if row[-1] is None else row


def events(study: Study, person: str | None = None) -> list[Any]:
    """Rows of all safety events: person, session, day, number of the trial, kind, count, unit of the count."""
    of, who = _of_person(person)
    question = (
        f"SELECT s.person, s.name, s.date, t.number, e.text, e.times, e.unit {FROM} JOIN events e ON e.trial = t.id "
        f"WHERE {of} ORDER BY s.person, {IN_ORDER}, t.number, e.rowid"
    )
    return study.rows(question, who)


def bounds(study: Study, person: str | None = None) -> list[Any]:
    """Rows of all bounds, each with the value that came closest to it in any trial; the closest one is first.

    A row has name, value, bound, unit, number of trials beyond the bound, and number of trials with this bound.
    """
    of, who = _of_person(person)
    question = (
        "SELECT b.name, b.value, b.bound, b.unit, sum(b.value > b.bound * 1.000001), count(*), max(b.value / b.bound) "
        f"{FROM} JOIN bounds b ON b.trial = t.id WHERE {of} AND b.bound > 0 GROUP BY b.name, b.unit ORDER BY 7 DESC"
    )
    return [row[:6] for row in study.rows(question, who)]


def stating_safety(study: Study, person: str | None = None) -> tuple[int, int]:
    """Two counts: the trials with a bound or a safety event, and all trials."""
    of, who = _of_person(person)
    states = "(EXISTS (SELECT 1 FROM bounds WHERE trial = t.id) OR EXISTS (SELECT 1 FROM events WHERE trial = t.id))"
    ((stating, trials),) = study.rows(f"SELECT coalesce(sum({states}), 0), count(*) {FROM} WHERE {of}", who)
    return stating, trials


def ground(study: Study, person: str | None = None) -> dict[tuple[str, str], dict[str, Any]]:
    """Corners [m] of the area that the hand covered, by group and person, then by session in order.

    Without a `person`, only the first and the last session of each person are included.
    """
    of, who = _of_person(person)
    places = "o.sessions > 1 AND o.place IN (1, o.sessions)" if person is None else "1"
    question = (
        "WITH o AS (SELECT s.id, count(*) OVER (PARTITION BY s.person) AS sessions, "
        f"row_number() OVER (PARTITION BY s.person ORDER BY {IN_ORDER}) AS place FROM sessions s WHERE EXISTS "
        "(SELECT 1 FROM trials t JOIN outlines x ON x.trial = t.id WHERE t.session = s.id AND t.status = ?)) "
        f"SELECT coalesce(s.\"group\", 'no group'), s.person, s.name, s.date, x.points {FROM} JOIN o ON o.id = s.id "
        f"JOIN outlines x ON x.trial = t.id WHERE t.status = ? AND {places} AND {of} ORDER BY 1, 2, o.place, t.number"
    )
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for group, name, session, date, points in study.rows(question, (DONE, DONE, *who)):
        label = f"{session}, {date}" if date else session
        found.setdefault((group, name), {}).setdefault(label, []).extend(json.loads(points))
    return found
