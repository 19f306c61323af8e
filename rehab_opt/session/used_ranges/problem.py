"""What a problem file of `system = "used_ranges"` may say, and what each key means."""

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
    """Folder of the files `RF_MEAN_*.csv` and `RGV_MEAN_*.csv` (Vanmechelen et al.), or of other tasks; beside the
    problem file, or `data:folder`."""
    tasks: Annotated[list[TaskName], Field(min_length=1, max_length=12), Once] = Field(default=["RF", "RGV"])
    """What the names of files begin with; reach forwards, and reach and grasp a vertical object."""
    cover: float = Field(default=0.5, ge=0.5, le=1)
    """Share of a group's limbs whose own limits lie within the group's: 0.5 is a typical limb, 1 all of them
    together."""
    pronation_zero_deg: Zero = 0.0
    """The files' pronation where the palm of the hanging arm faces forward; `"grasp"` takes it from the grasp
    itself."""


class VariationSection(Section):
    """People drawn around each group's typical limb, with the spread of its limbs."""

    people: int = Field(ge=2, le=1000)
    """How many people are drawn around each group's range."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Of the drawing."""
    at_least: float = Field(default=0.5, gt=0, le=1)
    """Share of them that reach every point of the outlined region."""
    spacing_mm: float = Field(default=5.0, ge=1, le=50)
    """Of the grid in the figure."""


class UsedRangesProblem(Problem):
    """Ranges used by two groups, and the workspaces of those ranges."""

    system: Literal["used_ranges"]
    recorded: RecordedSection
    """Whose reaches."""
    arm: ArmInPlane
    """The same segments for everybody."""
    variation: VariationSection | None = None
    """People drawn around each group."""
