"""Numbers of a study that its commands and its report show: who came how often, how a measure went, who did better."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import cache
from typing import NamedTuple, TypeVar

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.store import Study
from rehab_opt.study.trial import DONE
from rehab_opt.text_file import shown

__all__ = [
    "FROM",
    "IN_ORDER",
    "Interval",
    "Overview",
    "PersonSummary",
    "Quantity",
    "SessionMean",
    "grouped",
    "interval",
    "of_people",
    "of_person",
    "overview",
    "people",
    "quantities",
    "quantity",
    "session_means",
    "sessions",
    "slopes",
    "trend",
]

T = TypeVar("T")

FROM = "FROM people p JOIN sessions s ON s.person = p.id JOIN trials t ON t.session = s.id"
IN_ORDER = "s.visit IS NULL, s.visit, s.date IS NULL, s.date, s.id"
"""Of sessions: by visit, then by date, then as they came."""
MEASURED = f"{FROM} JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity"


class Interval(NamedTuple):
    """A mean and its 95 % confidence interval (Student's t), of `n` values; NaN ends where there is one."""

    mean: float
    lower: float
    upper: float
    n: int


class Overview(NamedTuple):
    """Counts of everything, and the days of the first and the last session."""

    people: int
    sessions: int
    trials: int
    failed: int
    first: str | None
    last: str | None


class PersonSummary(NamedTuple):
    """One person: how many sessions and trials, and when last."""

    name: str
    group: str | None
    sessions: int
    trials: int
    last: str | None


class Quantity(NamedTuple):
    """A measure by its name and unit; "" where its name says the unit, or it has none."""

    id: int
    name: str
    unit: str


class SessionMean(NamedTuple):
    """One person's session under one condition: its place among theirs, from 0, and the values of its trials."""

    person: str
    group: str | None
    session: str
    date: str | None
    order: int
    condition: str | None
    values: tuple[float, ...]
    of: Interval


def interval(values: Sequence[float]) -> Interval:
    """Mean of values and its 95 % confidence interval, as if they were independent and normal."""
    count = len(values)
    mean = math.fsum(values) / count if count else math.nan
    if count < 2:
        return Interval(mean, math.nan, math.nan, count)
    # hypot, since squares of what is absurdly large are no numbers any more
    from_mean = math.hypot(*(value - mean for value in values))
    half = _quantile(count - 1) * from_mean / math.sqrt((count - 1) * count)
    return Interval(mean, mean - half, mean + half, count)


@cache
def _quantile(freedom: int) -> float:
    """Student's t at 97.5 %, for whole degrees of freedom.

    Bisected from its closed form (Abramowitz and Stegun, 26.7.3 and 26.7.4): scipy takes a quarter of a second to load.
    """
    low, high = 1.9, 13.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        angle = math.atan2(middle, math.sqrt(freedom))
        odd = freedom % 2
        term = total = math.cos(angle) if odd else 1.0
        for k in range(2 + odd, freedom - 1, 2):
            term *= (k - 1) / k * math.cos(angle) ** 2
            total += term
        total *= math.sin(angle)
        within = 2 / math.pi * (angle + (total if freedom > 1 else 0.0)) if odd else total
        low, high = (middle, high) if within < 0.95 else (low, middle)
    return high


def overview(study: Study) -> Overview:
    """How much there is."""
    people, sessions, first, last = study.rows(
        "SELECT (SELECT count(*) FROM people), count(*), min(date), max(date) FROM sessions"
    )[0]
    trials, failed = study.rows("SELECT count(*), coalesce(sum(status <> ?), 0) FROM trials", (DONE,))[0]
    return Overview(people, sessions, trials, failed, first, last)


def people(study: Study) -> list[PersonSummary]:
    """Everybody, by name."""
    question = (
        'SELECT p.name, p."group", count(DISTINCT s.id), count(t.id), max(s.date) FROM people p '
        "LEFT JOIN sessions s ON s.person = p.id LEFT JOIN trials t ON t.session = s.id GROUP BY p.id ORDER BY p.name"
    )
    return [PersonSummary(*row) for row in study.rows(question)]


def quantities(study: Study, person: str | None = None) -> list[Quantity]:
    """Measures that there are, of everybody or of one person, in the order in which they came first."""
    of, who = of_person(person)
    question = "FROM quantities q" if person is None else f"{MEASURED} WHERE {of}"
    return [Quantity(*row) for row in study.rows(f"SELECT DISTINCT q.id, q.name, q.unit {question} ORDER BY q.id", who)]


def quantity(study: Study, name: str) -> Quantity:
    """The measure of a name, or of `name [unit]`.

    Raises
    ------
    ConfigurationError : there is none, or in two units.
    """
    known = quantities(study)
    found = [each for each in known if name in (each.name, f"{each.name} [{each.unit}]")]
    if len(found) != 1:
        near = get_close_matches(name, [each.name for each in known]) or [each.name for each in known[:5]]
        said = [f"{each.name} [{each.unit}]" for each in found] or near
        expected = f"a measure of this study, such as {', '.join(said)}" if said else "a study that has measures"
        raise ConfigurationError("--measure", shown(name), expected)
    return found[0]


def sessions(study: Study, person: str) -> list[tuple[str, int | None, str | None, str | None, int, int]]:
    """A person's sessions and conditions: name, visit, day, condition, trials, and how many of them are not done."""
    question = (
        f"SELECT s.name, s.visit, s.date, t.condition, count(t.id), coalesce(sum(t.status <> ?1), 0) {FROM} "
        f"WHERE p.name = ?2 GROUP BY s.id, t.condition ORDER BY {IN_ORDER}, t.condition"
    )
    return [(*row,) for row in study.rows(question, (DONE, person))]


def _session_order(study: Study, person: str | None = None) -> dict[int, int]:
    """Place of every session among those of its person, from 0: by visit, then by date, then as they came."""
    of, who = of_person(person)
    question = (
        f"SELECT s.id, row_number() OVER (PARTITION BY p.id ORDER BY {IN_ORDER}) - 1 "
        f"FROM sessions s JOIN people p ON p.id = s.person WHERE {of}"
    )
    return dict(study.rows(question, who))


def session_means(
    study: Study, measures: Sequence[Quantity], person: str | None = None
) -> dict[Quantity, list[SessionMean]]:
    """Of each measure every session's mean under each condition, in the order of the sessions.

    Trials that are not done, or without the number, do not count. The trials' values, and the interval of their mean,
    are there for one person alone.
    """
    of, bound = of_person(person)
    order = _session_order(study, person)
    question = (
        f'SELECT s.id, p.name, p."group", s.name, s.date FROM people p JOIN sessions s ON s.person = p.id WHERE {of}'
    )
    who = {key: (name, group, session, day) for key, name, group, session, day in study.rows(question, bound)}
    by_id = {each.id: each for each in measures}
    among = (
        f"{FROM} JOIN measures m ON m.trial = t.id WHERE {of} AND t.status = ? AND m.value IS NOT NULL "
        f"AND m.quantity IN ({', '.join('?' * len(by_id))})"
    )
    found: dict[int, list[SessionMean]] = {each: [] for each in by_id}
    if person is None:
        asked = f"SELECT m.quantity, s.id, t.condition, avg(m.value), count(*) {among} GROUP BY 1, 2, 3"
        for measure, session, condition, mean, count in study.each(asked, (DONE, *by_id)):
            interval_of = Interval(mean, math.nan, math.nan, count)
            found[measure].append(SessionMean(*who[session], order[session], condition, (), interval_of))
    else:
        values: dict[tuple[int, int, str | None], list[float]] = defaultdict(list)
        for *key, value in study.rows(f"SELECT m.quantity, s.id, t.condition, m.value {among}", (*bound, DONE, *by_id)):
            values[key[0], key[1], key[2]].append(value)
        for (measure, session, condition), of_trials in values.items():
            of_session = *who[session], order[session], condition
            found[measure].append(SessionMean(*of_session, tuple(of_trials), interval(of_trials)))
    for means in found.values():
        means.sort(key=lambda each: (each.person, each.order, each.condition or ""))
    return {by_id[measure]: means for measure, means in found.items()}


def of_person(person: str | None) -> tuple[str, tuple[str, ...]]:
    """What restricts a question to a person, if to any; no OR, which no index serves."""
    return ("1", ()) if person is None else ("p.name = ?", (person,))


def trend(means: Sequence[float]) -> Interval:
    """Slope of the straight line through values one after another, and its 95 % confidence interval; three at least."""
    n = len(means)
    x, y = (n - 1) / 2, math.fsum(means) / n
    spread = math.fsum((i - x) ** 2 for i in range(n))
    slope = math.fsum((i - x) * (value - y) for i, value in enumerate(means)) / spread
    rest = math.hypot(*(value - y - slope * (i - x) for i, value in enumerate(means)))
    half = _quantile(n - 2) * rest / math.sqrt((n - 2) * spread)
    return Interval(slope, slope - half, slope + half, n)


def grouped(means: Iterable[SessionMean], key: Callable[[SessionMean], T]) -> dict[T, list[SessionMean]]:
    """Sessions by what `key` says of them, in its order."""
    found: dict[T, list[SessionMean]] = defaultdict(list)
    for each in means:
        found[key(each)].append(each)
    return dict(sorted(found.items()))


def of_people(means: Iterable[SessionMean]) -> dict[str, float]:
    """Each person's mean over their sessions."""
    return {
        person: interval([each.of.mean for each in own]).mean
        for person, own in grouped(means, lambda each: each.person).items()
    }


def slopes(means: Iterable[SessionMean]) -> dict[str, float]:
    """Each person's own straight line through their sessions: change a session; of those with two sessions or more."""
    found = {}
    for person, own in grouped(means, lambda each: each.person).items():
        points = [(each.order, each.of.mean) for each in own]
        x, y = interval([x for x, _ in points]).mean, interval([y for _, y in points]).mean
        spread = math.fsum((each - x) ** 2 for each, _ in points)
        if spread > 0:
            found[person] = math.fsum((each - x) * (value - y) for each, value in points) / spread
    return found
