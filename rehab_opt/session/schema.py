"""What problem files of several systems may say: each key, its unit (the end of its name), its range, its default.

The keys of one system stand beside it. What stands below a key says what it means: `docs/reference/problem_files.md`
is made of it.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.session.text_lines import brief

__all__ = [
    "FORMS",
    "NAME",
    "NAMED",
    "TABLE",
    "UNUSABLE_SOLVERS",
    "ArmSection",
    "Length",
    "Limits",
    "Once",
    "PlacementSection",
    "PlanarPlacement",
    "Positive",
    "Problem",
    "RangeOfMotion",
    "RecordingSection",
    "Section",
    "SegmentsSection",
    "Side",
    "SolverName",
    "Triple",
    "refusal",
]

NAME, TABLE, NAMED = FORMS = ("<name>", "<table>", "<named>")
"""Which form of a key that has several was used; pydantic puts them into the place of an error."""

UNUSABLE_SOLVERS = ("scpgen",)
"""CasADi has them, but cannot make them of these problems and warns on the error stream while it tries."""

Side = Literal["left", "right"]
Positive = Annotated[float, Field(gt=0)]
Length = Annotated[float, Field(ge=-10, le=10)]
"""[m] A coordinate; larger ones are another unit."""


def _ordered(pair: list[float]) -> list[float]:
    if not pair[0] <= pair[1]:
        raise PydanticCustomError("inverted", "[lower, upper] with lower <= upper")
    if pair[1] - pair[0] > 360:
        raise PydanticCustomError("too_wide", "[lower, upper] at most 360 deg apart")
    return pair


def _bone(length: float) -> float:
    if not 50 <= length <= 1000:  # a long bone is 60 mm at birth, and less than 50 cm in anybody
        raise PydanticCustomError("unit", "50 to 1000 mm (is the length in another unit?)")
    return length


def _usable(solver: str) -> str:
    if solver in UNUSABLE_SOLVERS:
        raise PydanticCustomError("unusable", "a solver that this problem can be given to")
    return solver


def _different(values: list[str]) -> list[str]:
    if len(set(values)) < len(values):
        raise PydanticCustomError("repeated", "each one once")
    return values


Once = AfterValidator(_different)
"""Of a list: nothing stands in it twice."""
SolverName = Annotated[str, Field(min_length=1), AfterValidator(_usable)]
LongBone = Annotated[float, AfterValidator(_bone)]
Limits = Annotated[
    list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=2, max_length=2), AfterValidator(_ordered)
]
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


class Problem(Section):
    """The whole of a problem file."""

    system: str
    """Which kind of problem this is."""
    title: str = Field(min_length=1, max_length=120)
    """Heads table and figures."""


class RangeOfMotion(Section):
    """A person's own joint limits, counted as in Table I of Rossa et al.; equal ones lock the joint."""

    scapular_retraction_deg: Limits
    """`[lower, upper]` of joint 1, relative to its rest."""
    glenohumeral_rotation_deg: Limits
    """`[lower, upper]` of joint 2."""
    shoulder_adduction_deg: Limits
    """`[lower, upper]` of joint 3."""
    humeral_flexion_deg: Limits
    """`[lower, upper]` of joint 4."""
    forearm_extension_deg: Limits
    """`[lower, upper]` of joint 5."""
    wrist_flexion_deg: Limits
    """`[lower, upper]` of joint 6."""
    wrist_deviation_deg: Limits
    """`[lower, upper]` of joint 7."""
    wrist_supination_deg: Limits
    """`[lower, upper]` of joint 8."""


class SegmentsSection(Section):
    """Segment lengths l0 to l3 of Table I."""

    acromiohumeral_mm: float = Field(default=130.0, ge=0, le=1000)
    """l0."""
    humerus_mm: LongBone = 290.0
    """l1, 50 to 1000."""
    forearm_mm: LongBone = 300.0
    """l2, 50 to 1000."""
    hand_mm: float = Field(default=70.0, ge=0, le=1000)
    """l3, to the middle of the grip."""


class ArmSection(Section):
    """Whose arm."""

    side: Side
    """A right arm is the mirror image of the paper's left one."""
    range_of_motion: Annotated[
        Annotated[Literal["regular", "restricted"], Tag(NAME)] | Annotated[RangeOfMotion, Tag(TABLE)],
        Discriminator(lambda value: TABLE if isinstance(value, dict | RangeOfMotion) else NAME),
    ]
    """Table I of Rossa et al. by name, or a table of all eight joints' limits."""
    segments: SegmentsSection = SegmentsSection()
    """Lengths of the arm's segments."""
    handle_tilt_deg: float = Field(default=2.0, gt=0, le=90)
    """Largest angle between handle and vertical."""
    joint_speed_deg_s: float | None = Field(default=None, gt=0, le=3600)
    """Largest speed of every joint, which caps that of the smoother; by default `human_arm`'s (172), an assumption: the
    paper gives none."""
    joint_acceleration_deg_s2: float | None = Field(default=None, gt=0, le=1e6)
    """Largest acceleration of every joint, likewise; by default `human_arm`'s (1719)."""


class RecordingSection(Section):
    """Which movement, and whose hand made it."""

    file: str = Field(min_length=1)
    """A `.csv`, `.svc`, `.mot` or `.trc`, relative to the problem file, or `data:folder/file`."""
    hand: Side
    """Whose hand was recorded."""
    mirror: bool = False
    """Must be true if that is not the arm's side, and must not be if it is."""
    marker: str | None = None
    """The hand's marker, in a `.trc`."""
    columns: Annotated[list[str], Field(min_length=2, max_length=3)] | None = None
    """The columns of x, y (and z), in a `.csv` or `.mot`."""

    @model_validator(mode="after")
    def hand_is_named_as_its_file_allows(self) -> Self:
        """Refuse a marker or columns that the file's format has none of, and one column in two places."""
        suffix = PurePath(self.file).suffix.lower()
        if self.marker is not None and suffix != ".trc":
            raise refusal("marker", self.marker, "no such key: only a .trc has markers")
        if self.columns is not None and suffix not in (".csv", ".mot"):
            raise refusal("columns", self.columns, "no such key: only a .csv or .mot has named columns")
        if self.columns is not None and len(set(self.columns)) < len(self.columns):
            raise refusal("columns", self.columns, "each column once")
        return self


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
