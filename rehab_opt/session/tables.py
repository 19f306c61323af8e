"""The table of numbers, derived from the keys of the metrics."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

Numbers = Mapping[str, Any]
SMALL = 1e-3
"""Smaller numbers are written as `< 0.001`."""
UNITS: Mapping[str, tuple[str, float]] = {
    "m": ("mm", 1e3), "m_s": ("mm/s", 1e3), "m2": ("cm^2", 1e4), "m3": ("l", 1e3), "rad": ("rad", 1.0),
    "deg": ("deg", 1.0), "deg_s": ("deg/s", 1.0), "deg_s2": ("deg/s^2", 1.0), "deg_s3": ("deg/s^3", 1.0),
    "s": ("s", 1.0), "ms": ("ms", 1.0), "N": ("N", 1.0), "N_s": ("N/s", 1.0), "J": ("J", 1.0), "rate": ("%", 100.0),
    "fraction": ("%", 100.0), "fraction_of_limit": ("% of limit", 100.0),
    "fraction_of_time": ("% of the time", 100.0), "fraction_of_length": ("% of the length", 100.0),
}  # fmt: skip
"""For each ending of a key: the unit in the table, and the factor to it."""
LABELS: Mapping[str, str] = {
    "broken_any": "ticks that break a limit",
    "excess": "beyond the limit by, in SI units",
    "goals_met": "goals reached",
    "followed": "followed within 1 mm",
    "drive": "driven",
    "success": "trials that succeeded",
    "relaxed": "ticks in which a bound was relaxed",
    "scale": "commanded motion delivered",
    "stick_ignored": "ticks in which the stick moved nothing",
    "stopped": "ticks in which the controller braked or rested",
    "tick": "computing time of a tick",
}
"""Labels for quantities whose key is not readable English."""
KEY = re.compile(
    r"(?P<name>.+?)(?:_(?P<what>mean|median|p95|p99_9|p99|max|min))?"
    rf"(?:_(?P<unit>{'|'.join(sorted(UNITS, key=len, reverse=True))}))?",
    re.DOTALL,
)


def numbers_table(title: str, of: Mapping[str, Numbers], *, first: Sequence[str] = (), caption: str = "") -> Table:
    """Table of metrics with a row for each quantity and a column for each controller; the keys give labels and units.

    All statistics of a quantity share a row. A section's keys become rows `section: key`. Empty rows are left out.

    Parameters
    ----------
    of : metrics by controller.
    first : the only quantities or sections to show, in order, as keys without statistic and unit; by default all.
    """
    made = Table(title=Text(title), caption=Text(caption) if caption else None, caption_justify="left")
    made.add_column("quantity")
    rows: dict[str, dict[str, tuple[str, str]]] = {}
    for column, numbers in of.items():
        made.add_column(Text(column), justify="right")
        for name, label, cell in _quantities(numbers):
            rows.setdefault(name, {})[column] = (label, cell)
    wanted = [name for each in first for name in rows if name == each or name.startswith(f"{each}: ")] or rows
    for name in wanted:
        label, cells = next(iter(rows[name].values()))[0], [rows[name].get(column, ("", "-"))[1] for column in of]
        if any(set(cell) - set("- /") for cell in cells):
            made.add_row(Text(label), *map(Text, cells))
    return made


def _quantities(numbers: Numbers, above: str = "") -> Iterator[tuple[str, str, str]]:
    groups: dict[str, list[tuple[str, str, Any]]] = {}
    for key, value in numbers.items():
        found = KEY.fullmatch(str(key))
        if found is None or key == "parameters":
            continue
        name, what, unit = found["name"], found["what"] or "", found["unit"] or ""
        if isinstance(value, Mapping) and any(_unit(each) for each in value):
            name, what, unit = str(key), "", ""
        name = name.removesuffix("_joint").removesuffix("_max").removesuffix("_min")
        groups.setdefault(above + name, []).append((what, unit, value))
    for name, parts in groups.items():
        words = ": ".join(LABELS.get(each, each.replace("_", " ")) for each in name.split(": "))
        unit, section = parts[0][1:]
        if isinstance(section, Mapping):
            if all(type(each) is int for each in section.values()):
                yield name, words, ", ".join(f"{count} {what}" for what, count in section.items()) or "0"
            else:
                end = f"_{unit}" if unit else ""
                yield from _quantities({f"{key}{end}": of for key, of in section.items()}, f"{name}: ")
            continue
        whats = " / ".join(what.replace("_", ".") for what, of_unit, _ in parts if what and of_unit == unit)
        known = [(own, value) for _, own, value in parts if not isinstance(value, str)]
        cells = [_cell(value, own) for own, value in known if own == unit]
        notes = [f"{_cell(value, own)} {UNITS[own][0]}" for own, value in known if own not in ("", unit)]
        notes += [value.replace("_", " ") for *_, value in parts if isinstance(value, str)]
        label = " ".join(filter(None, (words, whats))) + (f", {UNITS[unit][0]}" if unit else "")
        said = f" ({', '.join(notes)})" if cells and notes else ", ".join(notes)
        yield name, label, " / ".join(cells) + said


def _unit(key: str) -> str:
    found = KEY.fullmatch(key)
    return "" if found is None else found["unit"] or ""


def _cell(value: Any, unit: str = "") -> str:
    if value is None or isinstance(value, bool):
        return {None: "-", True: "yes", False: "no"}[value]
    if isinstance(value, list):
        return ", ".join(_cell(each, unit) for each in value)
    if not isinstance(value, float):
        return str(value)
    number = value * UNITS.get(unit, ("", 1.0))[1]
    return f"{number:.3g}" if abs(number) >= SMALL or number == 0 else f"< {SMALL:g}" if number > 0 else f"> -{SMALL:g}"
