"""Keys of problem files with `system = "upper_limb"`."""

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

Weight = Annotated[float, Field(ge=0)]
PostureWeight = Annotated[
    Annotated[Weight, Tag(NAME)] | Annotated[dict[str, Weight], Tag(TABLE)],
    Discriminator(lambda value: TABLE if isinstance(value, dict) else NAME),
]


class RunSection(Section):
    """Sampling of the movement."""

    rate_hz: float = Field(default=100.0, ge=1, le=1000)
    """Samples per second of the path that the controllers follow."""


class OptimisedSection(Section):
    """The optimised controller, `ArmIK`."""

    solver: SolverName | None = None
    """Solver of `ArmIK`; default: `ArmIK`'s own. The option `--solver` overrides this key."""
    posture_cost: dict[str, PostureWeight] = Field(default={"rest": 1.0}, min_length=1)
    """Weights of the terms `rest`, `elbow`, `displacement`, `speed`, `acceleration` and `manipulability` of the posture
    cost. Each weight is a number, or a table with a number for each joint."""


class PublishedSection(Section):
    """The published controller, `TangentLaw`: Eqs. (8)-(14) of Rossa et al."""

    gain_per_s: float | None = Field(default=None, gt=0, le=1000)
    """Gain k0 of the paper; default: `TangentLaw`'s, 1000. The paper gives no values of k0 and mu; the defaults are the
    best of the grid that `python -m bench.tangent_law` prints."""
    damping: Positive | None = None
    """Damping mu of the paper, which requires mu << 1; default: `TangentLaw`'s, 1e-6."""


class SmoothingSection(Section):
    """Bounds of the drive's joint motion, the same for every joint."""

    speed_deg_s: float = Field(default=180.0, ge=1, le=1e4)
    """Largest joint speed; all joints wait for the slowest joint. If the arm has a lower limit, that limit holds."""
    acceleration_deg_s2: float = Field(default=1800.0, ge=1, le=1e7)
    """Largest joint acceleration. If the arm has a lower limit, that limit holds."""
    jerk_deg_s3: float = Field(default=180000.0, ge=1, le=1e10)
    """Largest joint jerk."""


class UpperLimb(Problem):
    """A person's arm follows a recorded hand path within the person's joint limits."""

    system: Literal["upper_limb"]
    arm: ArmSection
    """The participant's arm."""
    recording: RecordingSection
    """The recorded movement."""
    placement: PlacementSection
    """Position of the path relative to the shoulder."""
    run: RunSection = RunSection()
    """Sampling of the path."""
    optimised: OptimisedSection = OptimisedSection()
    """The optimised controller."""
    published: PublishedSection = PublishedSection()
    """The published controller."""
    smoothing: SmoothingSection = SmoothingSection()
    """Bounds of the drive's joint motion."""
