"""Keys of a person's arm: segments, plane, and range of motion in one of two conventions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.goniometer import arm_range_of_motion
from rehab_opt.session.schema import GONIOMETER, NAME, NAMED, TABLE, Length, Section, Side, Triple, refusal

__all__ = [
    "RADIANS",
    "AnyTilt",
    "ArmInPlane",
    "ArmOfOneRange",
    "ArmOfRanges",
    "ArmSection",
    "Limits",
    "OneRange",
    "RangeOfMotion",
    "SegmentsSection",
    "TableOneRange",
    "ranges_by_name",
]

RADIANS = 2 * math.pi
"""[deg] If all limits of a person are within this range, they were probably entered in radians."""
RANGE_DEG: Mapping[str, tuple[float, float]] = {
    "scapular_retraction": (-60, 60),
    "glenohumeral_rotation": (-150, 150),
    "shoulder_adduction": (-110, 180),
    "humeral_flexion": (-100, 190),
    "forearm_extension": (-90, 170),
    "wrist_flexion": (-110, 110),
    "wrist_deviation": (-190, 5),
    "wrist_supination": (-120, 220),
}
"""[deg] Widest limits accepted for a joint of Table I: wide enough for the ranges of modelled people, too narrow for
goniometer angles."""
LOOKS = "if these are goniometer angles, set convention = 'goniometer'"


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


LongBone = Annotated[float, AfterValidator(_bone)]
Limits = Annotated[
    list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=2, max_length=2), AfterValidator(_ordered)
]


def _radians(pair: list[float]) -> tuple[float, float]:
    return math.radians(pair[0]), math.radians(pair[1])


class RangeOfMotion(Section):
    """A person's own joint limits, in either convention."""

    def by_joint(self) -> dict[str, tuple[float, float]]:
        """(lower, upper) [rad] by joint, as `human_arm` takes them."""
        raise NotImplementedError

    @model_validator(mode="after")
    def angles_are_degrees(self) -> Self:
        """Refuse a table that is probably in radians, since an arm with these limits in degrees could hardly move."""
        pairs = {key: pair for key, pair in self if key.endswith("_deg")}
        if pairs and max(abs(limit) for pair in pairs.values() for limit in pair) <= RADIANS:
            key = max(pairs, key=lambda key: pairs[key][1] - pairs[key][0])
            raise refusal(key, pairs[key], "degrees: all of these limits together look like radians")
        return self


class TableOneRange(RangeOfMotion):
    """A person's own joint limits in the convention of Table I of Rossa et al.; equal limits lock the joint.

    For an arm that hangs with the palm forward, the angles are 0, 0, 90, 0, 0, 0, -90, 0.
    """

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

    def by_joint(self) -> dict[str, tuple[float, float]]:
        """(lower, upper) [rad] by joint."""
        return {name.removesuffix("_deg"): _radians(pair) for name, pair in self}

    @model_validator(mode="after")
    def limits_are_counted_as_table_i(self) -> Self:
        """Refuse angles that no joint reaches in this convention."""
        for joint, (least, most) in RANGE_DEG.items():
            pair = getattr(self, f"{joint}_deg")
            if not (least <= pair[0] and pair[1] <= most):
                expected = f"within {least:g} to {most:g} deg, counted as in Table I ({LOOKS})"
                raise refusal(f"{joint}_deg", pair, expected)
        return self


class GoniometerRange(RangeOfMotion):
    """A person's own range as a goniometer measures it, in the AAOS convention, which is the same for both arms.

    Zero: the arm hangs, elbow straight, thumb forward, hand in line with the forearm. Each movement is measured alone
    as [lower, upper] in the direction of its name: [-60, 180] is 60 deg of extension to 180 deg of flexion.
    """

    convention: Literal["goniometer"]
    """Convention of the angles below."""
    scapular_retraction_deg: Limits
    """Retraction from the shoulder at rest; negative: protraction."""
    shoulder_flexion_deg: Limits
    """In the sagittal plane; negative: extension."""
    shoulder_abduction_deg: Limits
    """In the frontal plane; negative: adduction."""
    shoulder_external_rotation_deg: Limits
    """Upper arm at the side, elbow at 90 deg, zero with the forearm forward; negative: internal rotation."""
    elbow_flexion_deg: Limits
    """Zero is the straight arm; negative: hyperextension. `[30, 120]`: the elbow extends no further than 30 deg of
    flexion."""
    forearm_pronation_deg: Limits
    """Elbow at 90 deg, zero with the thumb up; negative: supination."""
    wrist_flexion_deg: Limits
    """With the thumb up; negative: extension."""
    wrist_ulnar_deviation_deg: Limits
    """With the thumb up; negative: radial deviation."""

    def by_joint(self) -> dict[str, tuple[float, float]]:
        """(lower, upper) [rad] by joint."""
        return arm_range_of_motion(
            {name.removesuffix("_deg"): _radians(pair) for name, pair in self if name != "convention"}
        )

    @model_validator(mode="after")
    def people_have_such_angles(self) -> Self:
        """Refuse angles that nobody reaches."""
        try:
            self.by_joint()
        except ConfigurationError as refused:
            key = f"{refused.argument.split(chr(39))[1]}_deg"
            raise refusal(key, getattr(self, key), refused.expected) from refused
        return self


def _form_of_range(value: object) -> str:
    if isinstance(value, GoniometerRange) or (isinstance(value, dict) and "convention" in value):
        return GONIOMETER
    return TABLE if isinstance(value, dict | RangeOfMotion) else NAME


OwnRange = (
    Annotated[Literal["regular", "restricted", "figure_3"], Tag(NAME)]
    | Annotated[TableOneRange, Tag(TABLE)]
    | Annotated[GoniometerRange, Tag(GONIOMETER)]
)
OneRange = Annotated[OwnRange, Discriminator(_form_of_range)]
"""A named range of the paper, a table of the eight joints, or goniometer angles."""


class SegmentsSection(Section):
    """Segment lengths l0 to l3 of Table I."""

    acromiohumeral_mm: float = Field(default=130.0, ge=0, le=1000)
    """Length l0."""
    humerus_mm: LongBone = 290.0
    """Length l1, 50 to 1000."""
    forearm_mm: LongBone = 300.0
    """Length l2, 50 to 1000."""
    hand_mm: float = Field(default=70.0, ge=0, le=1000)
    """Length l3, to the middle of the grip."""


class ArmSection(Section):
    """The participant's arm."""

    side: Side
    """A right arm is the mirror image of the paper's left one."""
    range_of_motion: OneRange
    """`"regular"` or `"restricted"` (Table I of Rossa et al.), `"figure_3"` (W_c by the caption of Fig. 3), a table of
    the
    eight joints' limits, or goniometer angles."""
    segments: SegmentsSection = SegmentsSection()
    """Lengths of the arm's segments."""
    handle_tilt_deg: float = Field(default=2.0, gt=0, le=90)
    """Largest angle between the handle and the vertical."""
    joint_speed_deg_s: float | None = Field(default=None, gt=0, le=2160)
    """Largest speed of every joint, which also limits the drive; default: 172, an assumption of `human_arm`, since the
    paper gives none."""
    joint_acceleration_deg_s2: float | None = Field(default=None, gt=0, le=1e6)
    """Largest acceleration of every joint, which also limits the drive; default: 1719, an assumption of `human_arm`."""


LONGEST_NAME = 40


def _form_of_ranges(value: object) -> str:
    own = not isinstance(value, Mapping) or "convention" in value or any(str(key).endswith("_deg") for key in value)
    return _form_of_range(value) if own else NAMED


def _named_well(name: str) -> str:
    if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
        raise PydanticCustomError("name", f"a name of 1 to {LONGEST_NAME} printable characters")
    return name


RangeName = Annotated[str, AfterValidator(_named_well)]
NamedRanges = Annotated[
    OwnRange | Annotated[dict[RangeName, OneRange], Field(min_length=1, max_length=12), Tag(NAMED)],
    Discriminator(_form_of_ranges),
]
"""One range of motion, or several with names that the user chooses."""
AnyTilt = Annotated[
    Annotated[Literal["any"], Tag(NAME)] | Annotated[float, Field(ge=0, le=180), Tag(TABLE)],
    Discriminator(lambda value: NAME if isinstance(value, str) else TABLE),
]


class ArmInPlane(Section):
    """The arm, its plane, and the position of its shoulder."""

    side: Side
    """A right arm is the mirror image of the paper's left one."""
    segments: SegmentsSection = SegmentsSection()
    """Lengths of the arm's segments."""
    handle_tilt_deg: AnyTilt = 2.0
    """Largest angle between the handle and the vertical, or `"any"` for no limit."""
    plane_height_m: Length = -0.24
    """Height z of the plane in the frame of the shoulder."""
    accuracy_mm: float = Field(default=1.0, ge=0.01, le=50)
    """Largest distance between the computed boundary of the workspace and the true one."""
    shoulder_m: Triple = Field(default=[0.0, 0.0, 0.0])
    """Position of the shoulder in the robot's frame."""
    shoulder_turn_deg: float = Field(default=0.0, ge=-360, le=360)
    """Rotation of the shoulder's axes in the robot's frame, counterclockwise from above."""


class ArmOfOneRange(ArmInPlane):
    """An arm with one range of motion."""

    range_of_motion: OneRange
    """`"regular"`, `"restricted"` or `"figure_3"`, or a table of all eight joints' limits."""


class ArmOfRanges(ArmInPlane):
    """An arm with one range of motion, or with several that are compared."""

    range_of_motion: NamedRanges
    """One range: `"regular"`, `"restricted"` or `"figure_3"`, or a table of all eight joints' limits. Or up to 12 of
    them with names that you choose (no name ends in `_deg`), which are compared."""


def ranges_by_name(ranges: Any) -> dict[str, str | RangeOfMotion]:
    """The ranges of `NamedRanges` by name; a range without a name is called "own range"."""
    if isinstance(ranges, str):
        return {ranges: ranges}
    return {"own range": ranges} if isinstance(ranges, RangeOfMotion) else dict(ranges)
