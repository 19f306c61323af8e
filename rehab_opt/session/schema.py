"""What problem files of several systems may say: each key, its unit (the end of its name), its range, its default.

The keys of one system stand beside it. What stands below a key says what it means: `docs/reference/problem_files.md`
is made of it.
"""

from __future__ import annotations

import math
import re
from pathlib import PurePath
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.text_file import brief

__all__ = [
    "FORMS",
    "GONIOMETER",
    "NAME",
    "NAMED",
    "TABLE",
    "UNUSABLE_SOLVERS",
    "USABLE",
    "Decimal",
    "Length",
    "Once",
    "PlacementSection",
    "PlanarPlacement",
    "Positive",
    "Problem",
    "RecordedSection",
    "RecordingSection",
    "Section",
    "Separator",
    "Side",
    "SolverName",
    "Triple",
    "keys_of",
    "refusal",
]

NAME, TABLE, NAMED, GONIOMETER = FORMS = ("<name>", "<table>", "<named>", "<goniometer>")
"""Which form of a key that has several was used; pydantic puts them into the place of an error."""

UNUSABLE_SOLVERS = ("scpgen",)
"""CasADi has them, but cannot make them of these problems and warns on the error stream while it tries."""
USABLE = "a solver that this problem can be given to"

TO_SI = {"mm": 1e-3, "ms": 1e-3} | dict.fromkeys(("deg", "deg_s", "deg_s2", "deg_s3"), math.pi / 180)
"""What a number of a key that ends so is to be multiplied with."""
UNIT = re.compile(r"_(?:mm|ms|rad|deg(?:_s[23]?)?|(?:N|Ns|m)_(?:m|s)|per_s|kg|m|s|N|J)$")
Side = Literal["left", "right"]
Separator = Literal["comma", "semicolon", "tab", "blank"]
Decimal = Literal["point", "comma"]
Positive = Annotated[float, Field(gt=0)]
Length = Annotated[float, Field(ge=-10, le=10)]
"""[m] A coordinate; larger ones are another unit."""


def _usable(solver: str) -> str:
    if solver in UNUSABLE_SOLVERS:
        raise PydanticCustomError("unusable", USABLE)
    return solver


def _different(values: list[str]) -> list[str]:
    if len(set(values)) < len(values):
        raise PydanticCustomError("repeated", "each one once")
    return values


Once = AfterValidator(_different)
"""Of a list: nothing stands in it twice."""
SolverName = Annotated[str, Field(min_length=1), AfterValidator(_usable)]
Triple = Annotated[list[Length], Field(min_length=3, max_length=3)]


def refusal(key: str, value: object, expected: str) -> PydanticCustomError:
    """The error of a key that a whole section refuses."""
    return PydanticCustomError("refused", "{expected}", {"key": key, "value": brief(value), "expected": expected})


class Section(BaseModel):
    """A table of a problem file: no key but its own, no number for a text, no NaN."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def keys_are_known(cls, data: Any) -> Any:
        """Name the keys there are, where an unknown one is used."""
        if isinstance(data, dict):
            for key, value in data.items():
                if key not in cls.model_fields:
                    raise refusal(key, value, f"one of the keys {', '.join(cls.model_fields)}")
        return data

    def arguments(self, *keys: str, **named: str) -> dict[str, Any]:
        """What it says as arguments of the library: by names without their unit, in SI units; None is left out.

        Parameters
        ----------
        keys : which ones, all by default. named : what the library calls some of them otherwise.
        """
        found: dict[str, Any] = {}
        for key in keys or type(self).model_fields:
            name, value = UNIT.sub("", key), getattr(self, key)
            factor = TO_SI.get(key[len(name) + 1 :])
            if isinstance(value, list):
                value = tuple(value if factor is None else (factor * each for each in value))
            elif factor is not None and value is not None:
                value *= factor
            if value is not None:
                found[named.get(key, name)] = value
        return found


def keys_of(**sections: type[Section]) -> dict[str, str]:
    """Which dotted key says what the library calls by a name of its own: the reverse of `Section.arguments`."""
    return {UNIT.sub("", key): f"{name}.{key}" for name, section in sections.items() for key in section.model_fields}


class Problem(Section):
    """The whole of a problem file."""

    system: str
    """Which kind of problem this is."""
    title: str = Field(min_length=1, max_length=120)
    """Heads table and figures."""


class RecordedSection(Section):
    """Where a recorded movement lies, and how it is written."""

    file: str = Field(min_length=1)
    """A `.csv`, `.svc`, `.mot`, `.sto`, `.trc`, `.c3d`, `.xdf` or `_motion.tsv`, relative to the problem file,
    or `data:folder/file`."""
    marker: str | int | None = None
    """The hand's marker, in a `.trc`, `.c3d` or `_motion.tsv`: its name, or its number from 1 on."""
    columns: Annotated[list[str | int], Field(min_length=2, max_length=3)] | None = None
    """The columns of x, y (and z), in a `.csv`, `.mot`, `.sto` or `.xdf`: their names, or their numbers from 1 on."""
    time_column: str | int | None = None
    """The column of times in a `.csv`, likewise."""
    rate_hz: float | None = Field(default=None, gt=0, le=1e6)
    """Samples a second, in place of the file's times."""
    units: Annotated[list[str], Field(min_length=1, max_length=3), Once] | None = None
    """At most one each of length (m, cm, mm), angle (rad, deg) and time (s, ms, us, ns), in place of the file's."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """Its axis that points up: the points are turned so that z does."""
    window_s: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2, max_length=2)] | None = None
    """`[from, to]` after the first sample; the rest is left out."""
    trials: str | int | None = None
    """What separates the trials that are scored: a column of a `.csv`; of a `.c3d` the event with which each begins, or
    `"begin,end"`."""
    separator: Separator = "comma"
    """Between the cells of a `.csv`."""
    decimal: Decimal = "point"
    """Of the numbers in a `.csv`."""
    count_mm: float | None = Field(default=None, gt=0, le=1000)
    """What one raw count of length is, in a `.svc`, or in a `.csv` or `.c3d` whose header names no units."""
    tick_ms: float | None = Field(default=None, gt=0, le=1000)
    """What one raw count of time is, likewise."""
    speed: float = Field(default=1.0, ge=0.01, le=10)
    """Of the recorded pace: 0.5 takes twice as long."""

    @model_validator(mode="after")
    def hand_is_named_as_its_file_allows(self) -> Self:
        """Refuse a marker or columns that the file's format has none of, and one column in two places."""
        suffix = PurePath(self.file).suffix.lower()
        allowed = {
            "marker": ((".trc", ".c3d", ".tsv"), "markers"),
            "columns": ((".csv", ".mot", ".sto", ".xdf"), "named columns"),
            "separator": ((".csv",), "a separator of one's choice"),
            "decimal": ((".csv",), "decimals of one's choice"),
            "count_mm": ((".svc", ".csv", ".c3d"), "raw counts of length"),
            "tick_ms": ((".svc", ".csv"), "raw counts"),
            "time_column": ((".csv",), "a column of times of one's choice"),
            "trials": ((".csv", ".c3d"), "trials"),
        }
        for key, (suffixes, what) in allowed.items():
            if key in self.model_fields_set and getattr(self, key) is not None and suffix not in suffixes:
                some = f"{', '.join(suffixes[:-1])} or {suffixes[-1]}" if len(suffixes) > 1 else suffixes[0]
                raise refusal(key, getattr(self, key), f"no such key: only a {some} has {what}")
        if self.columns is not None and len(set(self.columns)) < len(self.columns):
            raise refusal("columns", self.columns, "each column once")
        return self

    def reading(self) -> dict[str, Any]:
        """How `read_recording` is to read the file."""
        return self.model_dump(include=set(RecordedSection.model_fields) - {"file"})


class RecordingSection(RecordedSection):
    """Which movement, and whose hand made it."""

    hand: Side
    """Whose hand was recorded."""
    mirror: bool = False
    """Must be true if that is not the arm's side, and must not be if it is."""


class PlanarPlacement(Section):
    """Where a movement lies in its plane."""

    centre_m: Annotated[list[Length], Field(min_length=2, max_length=2)]
    """`[x, y]` where the middle of the path's bounding box comes to lie."""
    turn_deg: float = Field(default=0.0, ge=-360, le=360)
    """Turn about the vertical, counterclockwise from above."""
    scale: float | None = Field(default=None, gt=0, le=1000)
    """Size, 1 where neither this nor `fit_m` is given."""
    fit_m: Annotated[list[Annotated[float, Field(gt=0, le=10)]], Field(min_length=2, max_length=2)] | None = None
    """`[width, depth]`: the largest size that fits, instead of `scale`."""

    @model_validator(mode="after")
    def size_is_said_once(self) -> Self:
        """Refuse two sizes."""
        if self.scale is not None and self.fit_m is not None:
            raise PydanticCustomError("two_sizes", "either scale or fit_m, not both")
        return self


class PlacementSection(PlanarPlacement):
    """Where a movement lies in the frame of the shoulder."""

    plane_height_m: Length = -0.24
    """z of the plane."""
