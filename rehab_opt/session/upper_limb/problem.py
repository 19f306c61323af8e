"""What a problem file of `system = "upper_limb"` may say; `problems/README.md` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from rehab_opt.session.arm_keys import ArmSection
from rehab_opt.session.schema import (
    NAME,
    TABLE,
    PlacementSection,
    Positive,
    Problem,
    RecordingSection,
    Section,
    SolverName,
)

__all__ = ["OptimisedSection", "PublishedSection", "RunSection", "SmoothingSection", "UpperLimb"]

Weight = Annotated[float, Field(ge=0)]
PostureWeight = Annotated[
    Annotated[Weight, Tag(NAME)] | Annotated[dict[str, Weight], Tag(TABLE)],
    Discriminator(lambda value: TABLE if isinstance(value, dict) else NAME),
]


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


class UpperLimb(Problem):
    """A recorded hand path followed within a person's joint limits."""

    system: Literal["upper_limb"]
    arm: ArmSection
    recording: RecordingSection
    placement: PlacementSection
    run: RunSection = RunSection()
    optimised: OptimisedSection = OptimisedSection()
    published: PublishedSection = PublishedSection()
    smoothing: SmoothingSection = SmoothingSection()
