"""What a report says of single trials: the best and the worst, safety events, bounds neared, the ground covered."""

from __future__ import annotations

import json
import math
from typing import NamedTuple

from rehab_opt.study.store import Study
from rehab_opt.study.summary import FROM, IN_ORDER, Quantity, of_person
from rehab_opt.study.trial import DONE

__all__ = [
    "Extreme",
    "Happened",
    "Neared",
    "TrialOutlines",
    "bounds",
    "events",
    "extreme",
    "growth",
    "outlines",
    "stating_safety",
]


Point = tuple[float, float]


class Extreme(NamedTuple):
    """A trial whose value is the largest or the smallest."""

    person: str
    session: str
    date: str | None
    trial: int
    condition: str | None
    value: float


class Happened(NamedTuple):
    """A safety event of a trial: what, how many times, counted in what."""

    person: str
    session: str
    date: str | None
    trial: int
    text: str
    times: float
    unit: str


class Neared(NamedTuple):
    """A limit, the nearest that a trial came to it, and how many of all trials passed it."""

    name: str
    value: float
    bound: float
    unit: str
    passed: int
    trials: int


class TrialOutlines(NamedTuple):
    """The corners [m] of all outlines of a session's trials."""

    session: str
    date: str | None
    points: list[tuple[float, float]]


def extreme(
    study: Study,
    measure: Quantity,
    *,
    largest: bool,
    person: str | None = None,
    least: float = -math.inf,
    most: float = math.inf,
) -> Extreme | None:
    """The trial, of those that are done, with the largest or the smallest value of a measure; None without any.

    Parameters
    ----------
    least, most : values beyond are no measurement.
    """
    of, who = of_person(person)
    end = "max" if largest else "min"
    question = (  # SQLite takes the bare columns from the row of the extreme
        f"SELECT p.name, s.name, s.date, t.number, t.condition, {end}(m.value) {FROM} "
        f"JOIN measures m ON m.trial = t.id WHERE {of} AND m.quantity = ? AND t.status = ? AND m.value BETWEEN ? AND ?"
    )
    (row,) = study.rows(question, (*who, measure.id, DONE, least, most))
    return None if row[-1] is None else Extreme(*row)


def events(study: Study, person: str | None = None) -> list[Happened]:
    """Every safety event."""
    of, who = of_person(person)
    question = (
        f"SELECT p.name, s.name, s.date, t.number, e.text, e.times, e.unit {FROM} JOIN events e ON e.trial = t.id "
        f"WHERE {of} ORDER BY p.id, s.id, t.number, e.id"
    )
    return [Happened(*row) for row in study.rows(question, who)]


def bounds(study: Study, person: str | None = None) -> list[Neared]:
    """Of each limit the nearest that a trial came, the nearest of all first."""
    of, who = of_person(person)
    question = (
        "SELECT b.name, b.value, b.bound, b.unit, sum(b.value > b.bound * 1.000001), count(*), max(b.value / b.bound) "
        f"{FROM} JOIN bounds b ON b.trial = t.id WHERE {of} AND b.bound > 0 GROUP BY b.name, b.unit ORDER BY 7 DESC"
    )
    return [Neared(*row[:6]) for row in study.rows(question, who)]


def stating_safety(study: Study, person: str | None = None) -> tuple[int, int]:
    """How many trials state a bound or a safety event, and how many there are."""
    of, who = of_person(person)
    states = "(EXISTS (SELECT 1 FROM bounds WHERE trial = t.id) OR EXISTS (SELECT 1 FROM events WHERE trial = t.id))"
    ((stating, trials),) = study.rows(f"SELECT coalesce(sum({states}), 0), count(*) {FROM} WHERE {of}", who)
    return stating, trials


def outlines(study: Study, person: str) -> list[TrialOutlines]:
    """A person's sessions in order, with the ground that the hand covered in them."""
    found: dict[int, TrialOutlines] = {}
    question = (
        f"SELECT s.id, s.name, s.date, o.points {FROM} JOIN outlines o ON o.trial = t.id "
        f"WHERE p.name = ? AND t.status = ? ORDER BY {IN_ORDER}, t.number"
    )
    for session, name, date, points in study.rows(question, (person, DONE)):
        found.setdefault(session, TrialOutlines(name, date, [])).points.extend((x, y) for x, y in json.loads(points))
    return list(found.values())


def growth(study: Study, *, most: int) -> dict[str | None, list[tuple[str, list[Point], list[Point]]]]:
    """By group the people with the ground of their first and of their last session, `most` of each group at most."""
    question = (
        "WITH ordered AS (SELECT s.id, s.person, count(*) OVER (PARTITION BY s.person) AS sessions, "
        f"row_number() OVER (PARTITION BY s.person ORDER BY {IN_ORDER}) AS place FROM sessions s WHERE EXISTS "
        "(SELECT 1 FROM trials t JOIN outlines o ON o.trial = t.id WHERE t.session = s.id AND t.status = ?1)) "
        'SELECT p.name, p."group", s.place > 1, o.points FROM ordered s JOIN people p ON p.id = s.person '
        "JOIN trials t ON t.session = s.id JOIN outlines o ON o.trial = t.id "
        "WHERE t.status = ?1 AND s.sessions > 1 AND s.place IN (1, s.sessions) ORDER BY p.id"
    )
    found: dict[str | None, dict[str, tuple[str, list[Point], list[Point]]]] = {}
    for name, group, last, points in study.each(question, (DONE,)):
        people = found.setdefault(group, {})
        if name in people or len(people) < most:
            _, first, after = people.setdefault(name, (name, [], []))
            (after if last else first).extend((x, y) for x, y in json.loads(points))
    return {group: list(people.values()) for group, people in found.items()}
