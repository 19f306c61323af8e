"""What a problem file of `system = "workspace"` may say, and what each key means."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rehab_opt.session.schema import Problem
from rehab_opt.session.workspaces.sections import ArmOfRanges

__all__ = ["WorkspaceProblem"]


class WorkspaceProblem(Problem):
    """Where an arm reaches with one or several ranges of motion."""

    system: Literal["workspace"]
    arm: ArmOfRanges
    """Whose arm."""
    volume: bool = False
    """Also the volumes of Fig. 3(a), with the handle held as above and free."""
    volume_accuracy_mm: float = Field(default=8.0, ge=1, le=50)
    """Of the slices that make up a volume."""
    volume_spacing_mm: float = Field(default=40.0, ge=5, le=500)
    """Distance of these slices."""
