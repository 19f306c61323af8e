"""What problem files say about an arm and the plane it reaches in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from rehab_opt.session.arm_keys import OneRange, OwnRange, RangeOfMotion, SegmentsSection, form_of_range
from rehab_opt.session.schema import NAME, NAMED, TABLE, Length, Section, Side, Triple

__all__ = ["ArmInPlane", "ArmOfOneRange", "ArmOfRanges", "OneRange", "ranges_by_name"]

LONGEST_NAME = 40


def _form(value: object) -> str:
    own = not isinstance(value, Mapping) or "convention" in value or any(str(key).endswith("_deg") for key in value)
    return form_of_range(value) if own else NAMED


def _named_well(name: str) -> str:
    if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
        raise PydanticCustomError("name", f"a name of 1 to {LONGEST_NAME} printable characters")
    return name


RangeName = Annotated[str, AfterValidator(_named_well)]
NamedRanges = Annotated[
    OwnRange | Annotated[dict[RangeName, OneRange], Field(min_length=1, max_length=12), Tag(NAMED)],
    Discriminator(_form),
]
"""One range, or several by names of the user's choice."""
AnyTilt = Annotated[
    Annotated[Literal["any"], Tag(NAME)] | Annotated[float, Field(ge=0, le=180), Tag(TABLE)],
    Discriminator(lambda value: NAME if isinstance(value, str) else TABLE),
]


class ArmInPlane(Section):
    """Whose arm, in which plane, and where its shoulder stands."""

    side: Side
    """A right arm is the mirror image of the paper's left one."""
    segments: SegmentsSection = SegmentsSection()
    """Lengths of the arm's segments."""
    handle_tilt_deg: AnyTilt = 2.0
    """Largest angle between handle and vertical, or `"any"` for no such bound."""
    plane_height_m: Length = -0.24
    """z of the plane in the frame of the shoulder."""
    accuracy_mm: float = Field(default=1.0, ge=0.01, le=50)
    """Largest distance between the boundary found and the true one."""
    shoulder_m: Triple = Field(default=[0.0, 0.0, 0.0])
    """The shoulder in the robot's frame."""
    shoulder_turn_deg: float = Field(default=0.0, ge=-360, le=360)
    """Turn of the shoulder's axes in the robot's frame, counterclockwise from above."""


class ArmOfOneRange(ArmInPlane):
    """With one range of motion."""

    range_of_motion: OneRange
    """Table I by name, or a table of all eight joints' limits."""


class ArmOfRanges(ArmInPlane):
    """With one range of motion, or several to be compared."""

    range_of_motion: NamedRanges
    """One range: Table I by name, or a table of all eight joints' limits. Or up to 12 of them by names of your choice
    (no name ends in `_deg`), which are compared."""


def ranges_by_name(ranges: Any) -> dict[str, str | RangeOfMotion]:
    """The ranges of `NamedRanges` with what they are called; one that has no name is the person's "own range"."""
    if isinstance(ranges, str):
        return {ranges: ranges}
    return {"own range": ranges} if isinstance(ranges, RangeOfMotion) else dict(ranges)
