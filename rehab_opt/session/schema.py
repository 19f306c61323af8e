"""Keys that problem files of several systems share; the end of a key's name is its unit.

Keys of one system are in that system's module. The docstring below a key is the key's description in
`docs/reference/problem_files.md` and in `rehab-opt keys`.
"""

from __future__ import annotations

import math
import re
from pathlib import PurePath
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.recordings.units import unused_keys
from rehab_opt.text_file import brief

NAME, TABLE, NAMED, GONIOMETER = FORMS = ("<name>", "<table>", "<named>", "<goniometer>")
"""Names of the forms that a key's value may have; pydantic reports these names in the location of an error."""

UNUSABLE_SOLVERS = ("scpgen",)
"""CasADi solvers that print warnings and cannot be built for these problems."""
USABLE = "a solver that this problem can be given to"

TO_SI = {"mm": 1e-3, "ms": 1e-3} | dict.fromkeys(("deg", "deg_s", "deg_s2", "deg_s3"), math.pi / 180)
"""Factors to SI units, by the unit at the end of a key."""
UNIT = re.compile(r"_(?:mm|ms|rad|deg(?:_s[23]?)?|(?:N|Ns|m)_(?:m|s)|per_s|kg|m|s|N|J)$")
Side = Literal["left", "right"]
Separator = Literal["comma", "semicolon", "tab", "blank"]
Decimal = Literal["point", "comma"]
Positive = Annotated[float, Field(gt=0)]
Length = Annotated[float, Field(ge=-10, le=10)]
"""A coordinate [m]; a larger number is probably in another unit."""


def _usable(solver: str) -> str:
    if solver in UNUSABLE_SOLVERS:
        raise PydanticCustomError("unusable", USABLE)
    return solver


def _different(values: list[str]) -> list[str]:
    if len(set(values)) < len(values):
        raise PydanticCustomError("repeated", "each one once")
    return values


Once = AfterValidator(_different)
"""Validator of a list whose values must differ."""
SolverName = Annotated[str, Field(min_length=1), AfterValidator(_usable)]
Triple = Annotated[list[Length], Field(min_length=3, max_length=3)]


def refusal(key: str, value: object, expected: str) -> PydanticCustomError:
    """Error about a key, for the validator of a section with several keys."""
    return PydanticCustomError("refused", "{expected}", {"key": key, "value": brief(value), "expected": expected})


class Section(BaseModel):
    """A table of a problem file; unknown keys, values of another type and NaN are errors."""

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True
    )
    FILES: ClassVar[tuple[str, ...]] = ()
    """Keys whose value is the name of a file, or a list of such names."""

    @model_validator(mode="before")
    @classmethod
    def keys_are_known(cls, data: Any) -> Any:
        """Raise an error that lists the known keys if there is an unknown key."""
        if isinstance(data, dict):
            for key, value in data.items():
                if key not in cls.model_fields:
                    raise refusal(key, value, f"one of the keys {', '.join(cls.model_fields)}")
        return data

    def arguments(self, *keys: str, **named: str) -> dict[str, Any]:
        """The section's values as arguments of a function, with names without units and values in SI units.

        Values of None are left out.

        Parameters
        ----------
        keys : keys to convert, by default all. named : name of the argument, for keys with another name.
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
    """Dotted keys of sections by the names of arguments, the inverse of `Section.arguments`."""
    return {UNIT.sub("", key): f"{name}.{key}" for name, section in sections.items() for key in section.model_fields}


class Problem(Section):
    """A whole problem file."""

    system: str
    """Kind of problem."""
    title: str = Field(min_length=1, max_length=120)
    """Title of the table and of the page."""


class RecordedSection(Section):
    """File and format of a recorded movement."""

    FILES: ClassVar = ("file",)
    file: str = Field(min_length=1)
    """Path of a `.csv`, `.svc`, `.mot`, `.sto`, `.trc`, `.c3d`, `.xdf` or `_motion.tsv` file, relative to the problem
    file; or `data:folder/file` for a file in the data folder."""
    marker: str | int | None = None
    """Marker of the hand in a `.trc`, `.c3d` or `_motion.tsv`: its name, or its number from 1."""
    columns: Annotated[list[str | int], Field(min_length=2, max_length=3)] | None = None
    """Columns of x, y (and z) in a `.csv`, `.mot`, `.sto` or `.xdf`: names, or numbers from 1."""
    time_column: str | int | None = None
    """Column of the times in a `.csv`: its name, or its number from 1."""
    rate_hz: float | None = Field(default=None, gt=0, le=1e6)
    """Samples per second; this rate replaces the times in the file."""
    units: Annotated[list[str], Field(min_length=1, max_length=3), Once] | None = None
    """Units that replace those in the file: at most one each of length (m, cm, mm), angle (rad, deg) and time (s, ms,
    us, ns)."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """The recording's axis that points up; the points are rotated so that z points up."""
    window_s: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2, max_length=2)] | None = None
    """Window `[from, to]` in seconds after the first sample; samples outside the window are ignored."""
    trials: str | int | None = None
    """Separation of trials for scoring: a column of a `.csv` with trial numbers; or, in a `.c3d`, the event at the
    start of each trial, or two events `"begin,end"`."""
    separator: Separator = "comma"
    """Separator of the cells of a `.csv`."""
    decimal: Decimal = "point"
    """Decimal sign of the numbers in a `.csv`."""
    count_mm: float | None = Field(default=None, gt=0, le=1000)
    """Length of one raw count in a `.svc`, or in a `.csv` or `.c3d` whose header has no units."""
    tick_ms: float | None = Field(default=None, gt=0, le=1000)
    """Duration of one raw count of time in a `.svc`, or in a `.csv` whose header has no units."""
    speed: float = Field(default=1.0, ge=0.01, le=10)
    """Playback speed; at 0.5 the movement takes twice as long."""

    @model_validator(mode="after")
    def hand_is_named_as_its_file_allows(self) -> Self:
        """Refuse keys that the file's format does not have, such as a marker of a `.csv`, and a column used twice."""
        given = {key: getattr(self, key) for key in self.model_fields_set}
        for unused in unused_keys(PurePath(self.file).suffix.lower(), given):
            raise refusal(*unused)
        return self

    def reading(self) -> dict[str, Any]:
        """The section's values as arguments of `read_recording`."""
        return self.model_dump(include=set(RecordedSection.model_fields) - {"file"})


class RecordingSection(RecordedSection):
    """A recorded movement, and the hand that made the movement."""

    hand: Side
    """The hand that was recorded."""
    mirror: bool = False
    """Whether the movement is mirrored: must be true if the recorded hand is not on the arm's side, else false."""


class PlanarPlacement(Section):
    """Position of a movement in its plane."""

    centre_m: Annotated[list[Length], Field(min_length=2, max_length=2)]
    """Centre `[x, y]` of the path's bounding box."""
    turn_deg: float = Field(default=0.0, ge=-360, le=360)
    """Rotation of the path about the vertical, counterclockwise from above."""
    scale: float | None = Field(default=None, gt=0, le=1000)
    """Scale factor of the path; 1 if neither `scale` nor `fit_m` is given."""
    fit_m: Annotated[list[Annotated[float, Field(gt=0, le=10)]], Field(min_length=2, max_length=2)] | None = None
    """Size `[width, depth]` of a box; the path gets the largest scale that fits into the box. Replaces `scale`."""

    @model_validator(mode="after")
    def size_is_said_once(self) -> Self:
        """Refuse both `scale` and `fit_m`."""
        if self.scale is not None and self.fit_m is not None:
            raise PydanticCustomError("two_sizes", "either scale or fit_m, not both")
        return self


class PlacementSection(PlanarPlacement):
    """Position of a movement in the frame of the shoulder."""

    plane_height_m: Length = -0.24
    """Height z of the movement's plane above the shoulder; negative below."""
