"""What a problem file of `system = "used_ranges"` may say; `problems/README.md` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from rehab_opt.session.schema import NAME, TABLE, Once, Problem, Section
from rehab_opt.session.workspaces.sections import ArmInPlane

__all__ = ["RecordedSection", "UsedRangesProblem", "VariationSection"]

Zero = Annotated[
    Annotated[Literal["grasp"], Tag(NAME)] | Annotated[float, Field(ge=-180, le=180), Tag(TABLE)],
    Discriminator(lambda value: NAME if isinstance(value, str) else TABLE),
]


TaskName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9-]{0,19}$")]


class RecordedSection(Section):
    """Whose reaches: the files of Vanmechelen et al. in one folder."""

    folder: str = Field(min_length=1)
    tasks: Annotated[list[TaskName], Field(min_length=1, max_length=12), Once] = Field(default=["RF", "RGV"])
    cover: float = Field(default=0.5, ge=0.5, le=1)
    pronation_zero_deg: Zero = 0.0


class VariationSection(Section):
    """People drawn around each group's typical limb, with the spread of its limbs."""

    people: int = Field(ge=2, le=1000)
    seed: int = Field(default=0, ge=0, le=2**31)
    at_least: float = Field(default=0.5, gt=0, le=1)
    spacing_mm: float = Field(default=5.0, ge=1, le=50)


class UsedRangesProblem(Problem):
    """Ranges used by two groups, and the workspaces of those ranges."""

    system: Literal["used_ranges"]
    recorded: RecordedSection
    arm: ArmInPlane
    variation: VariationSection | None = None
