"""What a problem file may say: every key, its unit (the end of its name), its range and its default.

`problems/README.md` says what each key means for the problem that is solved.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.session.text_lines import brief

__all__ = [
    "NAME",
    "TABLE",
    "UNUSABLE_SOLVERS",
    "ArmSection",
    "CircleSection",
    "OptimisedSection",
    "PlacementSection",
    "PoseTracking",
    "PublishedSection",
    "RangeOfMotion",
    "RecordingSection",
    "RobotSection",
    "RunSection",
    "SegmentsSection",
    "SmoothingSection",
    "TrackerSection",
    "UpperLimb",
]

NAME, TABLE = "<name>", "<table>"
"""Which form of a key that has two was used; pydantic puts them into the place of an error."""

MOST_TICKS = 2_000_000
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
    if not 20 <= length <= 1000:
        raise PydanticCustomError("unit", "20 to 1000 mm (is the length in another unit?)")
    return length


def _usable(solver: str) -> str:
    if solver in UNUSABLE_SOLVERS:
        raise PydanticCustomError("unusable", "a solver that this problem can be given to")
    return solver


SolverName = Annotated[str, Field(min_length=1), AfterValidator(_usable)]
LongBone = Annotated[float, AfterValidator(_bone)]
Limits = Annotated[
    list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=2, max_length=2), AfterValidator(_ordered)
]
Weight = Annotated[float, Field(ge=0)]
PostureWeight = Annotated[
    Annotated[Weight, Tag(NAME)] | Annotated[dict[str, Weight], Tag(TABLE)],
    Discriminator(lambda value: TABLE if isinstance(value, dict) else NAME),
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


class RangeOfMotion(Section):
    """A person's own joint limits, counted as in Table I of Rossa et al.; equal ones lock the joint."""

    scapular_retraction_deg: Limits
    glenohumeral_rotation_deg: Limits
    shoulder_adduction_deg: Limits
    humeral_flexion_deg: Limits
    forearm_extension_deg: Limits
    wrist_flexion_deg: Limits
    wrist_deviation_deg: Limits
    wrist_supination_deg: Limits


class SegmentsSection(Section):
    """Segment lengths l0 to l3 of Table I."""

    acromiohumeral_mm: float = Field(default=130.0, ge=0, le=1000)
    humerus_mm: LongBone = 290.0
    forearm_mm: LongBone = 300.0
    hand_mm: float = Field(default=70.0, ge=0, le=1000)


class ArmSection(Section):
    """Whose arm."""

    side: Side
    range_of_motion: Annotated[
        Annotated[Literal["regular", "restricted"], Tag(NAME)] | Annotated[RangeOfMotion, Tag(TABLE)],
        Discriminator(lambda value: TABLE if isinstance(value, dict | RangeOfMotion) else NAME),
    ]
    segments: SegmentsSection = SegmentsSection()
    handle_tilt_deg: float = Field(default=2.0, gt=0, le=90)
    joint_speed_deg_s: float | None = Field(default=None, gt=0, le=3600)
    joint_acceleration_deg_s2: float | None = Field(default=None, gt=0, le=1e6)


class RecordingSection(Section):
    """Which movement, and whose hand made it."""

    file: str = Field(min_length=1)
    hand: Side
    mirror: bool = False
    marker: str | None = None
    columns: Annotated[list[str], Field(min_length=2, max_length=3)] | None = None

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


class PlacementSection(Section):
    """Where the movement lies in the frame of the shoulder."""

    centre_m: Annotated[list[Length], Field(min_length=2, max_length=2)]
    plane_height_m: Length = -0.24
    turn_deg: float = Field(default=0.0, ge=-360, le=360)
    scale: float | None = Field(default=None, gt=0, le=1000)
    fit_m: Annotated[list[Annotated[float, Field(gt=0, le=10)]], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def size_is_said_once(self) -> Self:
        """Refuse two sizes."""
        if self.scale is not None and self.fit_m is not None:
            raise PydanticCustomError("two_sizes", "either scale or fit_m, not both")
        return self


class RunSection(Section):
    """How densely the movement is sampled."""

    rate_hz: float = Field(default=100.0, ge=1, le=1000)


class OptimisedSection(Section):
    """The optimised law, `ArmIK`."""

    solver: SolverName | None = None
    posture_cost: dict[str, PostureWeight] = Field(default={"rest": 1.0}, min_length=1)


class PublishedSection(Section):
    """The published law, `TangentLaw`: Eqs. (8)-(14) of Rossa et al."""

    gain_per_s: float | None = Field(default=None, gt=0, le=1000)
    damping: Positive | None = None


class SmoothingSection(Section):
    """Bounds of the smoothed joint motion; the same for every joint."""

    speed_deg_s: float = Field(default=180.0, ge=1, le=1e4)
    acceleration_deg_s2: float = Field(default=1800.0, ge=1, le=1e7)
    jerk_deg_s3: float = Field(default=180000.0, ge=1, le=1e10)


class UpperLimb(Section):
    """A recorded hand path followed within a person's joint limits."""

    system: Literal["upper_limb"]
    title: str = Field(min_length=1, max_length=120)
    arm: ArmSection
    recording: RecordingSection
    placement: PlacementSection
    run: RunSection = RunSection()
    optimised: OptimisedSection = OptimisedSection()
    published: PublishedSection = PublishedSection()
    smoothing: SmoothingSection = SmoothingSection()


class RobotSection(Section):
    """Which robot, and from where it starts."""

    model: Literal["ur5"]
    start_deg: Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=6, max_length=6)]
    joint_speed_deg_s: Annotated[float, Field(gt=0, le=180)] = 180.0
    joint_acceleration_deg_s2: Annotated[float, Field(gt=0, le=1e5)] | None = None


class CircleSection(Section):
    """A circle of the tool through its starting point, from rest to rest."""

    radius_m: float = Field(gt=0, le=1)
    normal: Triple = [0.0, 0.0, 1.0]
    towards: Triple = [1.0, 0.0, 0.0]
    turns: float = Field(default=1.0, gt=0, le=100)
    duration_s: float = Field(gt=0, le=600)
    swing_deg: float = Field(default=0.0, ge=0, le=90)

    @model_validator(mode="after")
    def directions_differ(self) -> Self:
        """Refuse a circle without a plane."""
        (a, b, c), (x, y, z) = self.normal, self.towards
        if (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2 < 1e-12:
            raise PydanticCustomError("no_plane", "normal and towards neither zero nor parallel")
        return self


class TrackerSection(Section):
    """The tracking law, `PoseTracker`."""

    rate_hz: float = Field(default=1000.0, ge=10, le=10000)
    gain_per_s: float | None = Field(default=None, gt=0, le=10000)
    solver: SolverName | None = None


class PoseTracking(Section):
    """A robot whose tool follows a moving pose."""

    system: Literal["pose_tracking"]
    title: str = Field(min_length=1, max_length=120)
    robot: RobotSection
    circle: CircleSection
    tracker: TrackerSection = TrackerSection()

    @model_validator(mode="after")
    def ticks_fit_into_memory(self) -> Self:
        """Refuse a run that is as long as it is dense."""
        rate, duration = self.tracker.rate_hz, self.circle.duration_s
        if rate * duration > MOST_TICKS:
            raise refusal("tracker.rate_hz", rate, f"at most {MOST_TICKS} ticks in circle.duration_s = {duration:g}")
        return self
