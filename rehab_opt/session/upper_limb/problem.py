"""Keys of a problem file of `system = "upper_limb"`, with their meaning."""

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
    """Sampling of the movement."""

    rate_hz: float = Field(default=100.0, ge=1, le=1000)
    """Samples per second of the path for the controllers."""


class OptimisedSection(Section):
    """The optimised controller, `ArmIK`."""

    solver: SolverName | None = None
    """A solver for `ArmIK`; default: its own; `--solver` overrides it."""
    posture_cost: dict[str, PostureWeight] = Field(default={"rest": 1.0}, min_length=1)
    """Weights of the terms of the posture cost (`rest`, `elbow`, `displacement`, `speed`, `acceleration`,
    `manipulability`), each one number or a table by joint."""


class PublishedSection(Section):
    """The published controller, `TangentLaw`: Eqs. (8)-(14) of Rossa et al."""

    gain_per_s: float | None = Field(default=None, gt=0, le=1000)
    """k0; default: `TangentLaw`'s (1000). The paper gives no value; the defaults of this and the next key are the best
    of the grid that `python -m bench.tangent_law` prints."""
    damping: Positive | None = None
    """mu; default: `TangentLaw`'s (1e-6); the paper requires mu << 1."""


class SmoothingSection(Section):
    """Bounds of the drive's joint motion, equal for every joint."""

    speed_deg_s: float = Field(default=180.0, ge=1, le=1e4)
    """Largest speed; all joints wait for the slowest one. A lower limit of the arm takes precedence."""
    acceleration_deg_s2: float = Field(default=1800.0, ge=1, le=1e7)
    """Largest acceleration; a lower limit of the arm takes precedence."""
    jerk_deg_s3: float = Field(default=180000.0, ge=1, le=1e10)
    """Largest jerk; the arm has no limit of its own."""


class UpperLimb(Problem):
    """A recorded hand path followed within a person's joint limits."""

    system: Literal["upper_limb"]
    arm: ArmSection
    """The participant's arm."""
    recording: RecordingSection
    """The recorded movement."""
    placement: PlacementSection
    """Position of the path."""
    run: RunSection = RunSection()
    """The sampling."""
    optimised: OptimisedSection = OptimisedSection()
    """The optimised controller."""
    published: PublishedSection = PublishedSection()
    """The published controller."""
    smoothing: SmoothingSection = SmoothingSection()
    """Bounds of the drive."""
