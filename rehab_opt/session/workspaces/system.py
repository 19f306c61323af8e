"""`system = "workspace"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.systems import System
from rehab_opt.session.workspaces.outcome import WorkspaceOutcome
from rehab_opt.session.workspaces.problem import WorkspaceProblem
from rehab_opt.session.workspaces.run import run_workspace
from rehab_opt.session.workspaces.sections import ranges_by_name

__all__ = ["WorkspaceSystem"]


class WorkspaceSystem(System[WorkspaceProblem, WorkspaceOutcome]):
    """The reachable workspaces of an arm."""

    schema = WorkspaceProblem
    shown = ("rehab_opt.session.workspaces.shown",)

    def check(self, loaded: ProblemFile[WorkspaceProblem]) -> tuple[str, ...]:
        """Builds the arms."""
        self.arms(loaded)
        return ()

    def arms(self, loaded: ProblemFile[WorkspaceProblem]) -> dict[str, SerialChain]:
        """An arm for each range of motion."""
        arm = loaded.problem.arm
        return {
            name: arm_of(arm.side, arm.segments, limits, file=loaded.file)
            for name, limits in ranges_by_name(arm.range_of_motion).items()
        }

    def run(
        self, loaded: ProblemFile[WorkspaceProblem], *, options: Mapping[str, str], progress: Progress
    ) -> WorkspaceOutcome:
        """No options."""
        return run_workspace(loaded, progress=progress)
