"""What a problem file of `system = "workspace"` may say; `problems/README.md` says what each key means."""

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
    volume: bool = False
    volume_accuracy_mm: float = Field(default=8.0, ge=1, le=50)
    volume_spacing_mm: float = Field(default=40.0, ge=5, le=500)
