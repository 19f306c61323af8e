"""Settings for reading a recording, such as columns, and units that complete or replace those in the file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import PurePath
from types import MappingProxyType
from typing import Any

from rehab_opt.errors import ProblemFileError
from rehab_opt.text_file import brief, shown

__all__ = [
    "ANGLE", "COUNTS", "FORCE", "KINDS", "LENGTH", "RATES", "TIME", "UNITS", "Reading", "each_once",
    "known_unit", "place_of", "unused_keys",
]  # fmt: skip

TIME = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})
LENGTH = MappingProxyType({"m": 1.0, "cm": 1e-2, "mm": 1e-3})
ANGLE = MappingProxyType({"rad": 1.0, "deg": math.pi / 180})
FORCE = MappingProxyType({"N": 1.0})
UNITS: Mapping[str, float] = MappingProxyType({**TIME, **LENGTH, **ANGLE, **FORCE})
KINDS = MappingProxyType({"length": LENGTH, "angle": ANGLE, "time": TIME})
RATES = re.compile(r"veloc|speed|accel|deriv|kinematics_(u|dudt)|_(vel|acc|d{0,2}dot)$", re.IGNORECASE)
"""Pattern of names of velocities and accelerations."""
COUNTS = "counts"
"""Unit of a column whose header has none: raw counts of a device."""
SPELLINGS = {
    **{f"{short}sec{end}": f"{short}s" for short in ("", "m", "u", "n") for end in ("", "s")},
    **{f"{part}second{end}": f"{short}s" for part, short in (("", ""), ("milli", "m"), ("micro", "u"), ("nano", "n"))
       for end in ("", "s")},
    **{f"{part}met{end}": f"{short}m" for part, short in (("", ""), ("centi", "c"), ("milli", "m"))
       for end in ("er", "re", "ers", "res")},
    "\u00b5s": "us", "\u03bcs": "us", "°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
}  # fmt: skip


USED_BY: Mapping[str, tuple[tuple[str, ...], str]] = MappingProxyType({
    "marker": ((".trc", ".c3d", ".tsv"), "markers"),
    "columns": ((".csv", ".mot", ".sto", ".xdf"), "named columns"),
    "separator": ((".csv",), "a separator of one's choice"),
    "decimal": ((".csv",), "decimals of one's choice"),
    "count_mm": ((".svc", ".csv", ".c3d"), "raw counts of length"),
    "tick_ms": ((".svc", ".csv"), "raw counts"),
    "time_column": ((".csv",), "a column of times of one's choice"),
    "trials": ((".csv", ".c3d"), "trials"),
})  # fmt: skip
"""For each key: suffixes of the formats that use it, and its meaning in words; other keys fit every format."""


def unused_keys(suffix: str, given: Mapping[str, Any]) -> Iterator[tuple[str, Any, str]]:
    """Yield key, value and expectation of each given key that this format cannot use, or that `rate_hz` replaces."""
    for key, (suffixes, what) in USED_BY.items():
        if given.get(key) is not None and suffix not in suffixes:
            some = f"{', '.join(suffixes[:-1])} or {suffixes[-1]}" if len(suffixes) > 1 else suffixes[0]
            yield key, given[key], f"no such key: only a {some} has {what}"
    for key in ("time_column", "tick_ms"):
        if given.get("rate_hz") is not None and given.get(key) is not None:
            yield key, given[key], "no such key: rate_hz replaces the file's times"


def known_unit(text: str) -> str:
    """Symbol of a unit in any spelling; the text itself if the unit is unknown."""
    spelled = SPELLINGS.get(text.lower(), text)
    return spelled if spelled in UNITS or spelled.lower() not in UNITS else spelled.lower()


def place_of(asked: str | int, names: Sequence[str], count: int | None = None) -> int | None:
    """Index of a column or marker by its name or its number from 1 (an `int` or digits); None if there is none."""
    found = [place for place, name in enumerate(names) if name == str(asked) and not isinstance(asked, int)]
    if found or not (str(asked).isascii() and str(asked).isdecimal() and len(str(asked)) < 6):
        return found[0] if len(found) == 1 else None
    return int(asked) - 1 if 1 <= int(asked) <= (count or len(names)) else None


def each_once(found: Sequence[Any], how: Reading, name: str) -> list[Any]:
    """The columns that `recording.columns` names or numbers; raises `ProblemFileError` if one is named twice."""
    if len(set(found)) < len(found):
        raise ProblemFileError(name, "recording.columns", list(how.columns or ()), "each column once")
    return list(found)


@dataclass(frozen=True)
class Reading:
    """A user's settings for a file; they mean the same as the `recording` keys of a problem file.

    `told` collects notes, and `used` collects the kinds of units that occur in the file.
    """

    columns: Sequence[str | int] | None = None
    marker: str | int | None = None
    separator: str = "comma"
    decimal: str = "point"
    count_mm: float | None = None
    tick_ms: float | None = None
    units: Sequence[str] | None = None
    time_column: str | int | None = None
    rate_hz: float | None = None
    trials: str | int | None = None
    told: list[str] = field(default_factory=list)
    used: set[str] = field(default_factory=set)

    def stated(self, kind: str) -> str | None:
        """Unit that the user states for a kind ("length", "angle" or "time"); None if the user states none."""
        return next((known_unit(unit) for unit in self.units or () if known_unit(unit) in KINDS[kind]), None)

    def counted(self, kind: str) -> float | None:
        """Factor that the user states from raw numbers without a unit to SI units [m, s]; None if not stated."""
        unit, one = self.stated(kind), {"length": self.count_mm, "time": self.tick_ms}.get(kind)
        return KINDS[kind][unit] if unit is not None else None if one is None else 1e-3 * one

    def factor(self, kind: str, said: str | None, *, name: str, where: str) -> float:
        """Factor to SI units [m, rad, s] from the unit `said` in a file, or from the unit that the user states instead.

        Raises
        ------
        ProblemFileError : neither the file nor the user state a known unit; the message names the place `where`.
        """
        self.used.add(kind)
        known, stated = known_unit((said or "").strip()), self.stated(kind)
        if stated is not None:
            note = f"{kind}s are read in {stated}, as stated, not in {shown(known)}"
            if known not in ("", stated) and note not in self.told:
                self.told.append(note)
            return KINDS[kind][stated]
        one, key = self.counted(kind), {"length": "count_mm", "time": "tick_ms"}.get(kind)
        if known in KINDS[kind]:
            note = f"recording.{key} is not used, since the file has a unit of {kind}"
            if one is not None and note not in self.told:
                self.told.append(note)
            return KINDS[kind][known]
        if not known and one is not None:
            return one
        expected = f"one of {', '.join(KINDS[kind])}, or recording.units"
        if key and not known and PurePath(name).suffix.lower() in USED_BY[key][0]:
            expected += f" (or recording.{key}, its unit in {key[-2:]})"
        raise ProblemFileError(name, where, brief(said), expected)

    def unused(self) -> list[str]:
        """Units that the user states for quantities which the file does not have."""
        return [unit for kind in KINDS if kind not in self.used and (unit := self.stated(kind)) is not None]

    def check(self, name: str, suffix: str) -> None:
        """Check numbers, units, and that a file with this suffix can use all given keys.

        Raises
        ------
        ProblemFileError : a setting is invalid; the message names its key.
        """
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        given = {each.name: given[each.name] for each in fields(self) if given[each.name] != each.default}
        for key, value, expected in unused_keys(suffix, given):
            raise ProblemFileError(name, f"recording.{key}", value, expected)
        for key in ("count_mm", "tick_ms", "rate_hz"):
            value = getattr(self, key)
            if value is not None and not 0 < value < math.inf:
                raise ProblemFileError(name, f"recording.{key}", value, "a finite number above zero")
        kinds = [next((kind for kind in KINDS if known_unit(unit) in KINDS[kind]), "") for unit in self.units or ()]
        if "" in kinds or len({*kinds}) < len(kinds):
            expected = f"one of each of {'; '.join(', '.join(units) for units in KINDS.values())}"
            raise ProblemFileError(name, "recording.units", list(self.units or ()), expected)
        for kind, key in (("length", "count_mm"), ("time", "tick_ms")):
            if self.stated(kind) and getattr(self, key) is not None:
                raise ProblemFileError(name, f"recording.{key}", getattr(self, key), f"either it or a unit of {kind}")
