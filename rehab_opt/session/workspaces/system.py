"""`system = "workspace"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.systems import Column, Needed
from rehab_opt.session.workspaces.outcome import WorkspaceOutcome
from rehab_opt.session.workspaces.problem import WorkspaceProblem
from rehab_opt.session.workspaces.run import run_workspace
from rehab_opt.session.workspaces.sections import ranges_by_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = ["WorkspaceSystem"]


class WorkspaceSystem:
    """The reachable workspaces of an arm."""

    schema = WorkspaceProblem
    options: frozenset[str] = frozenset()

    def recordings(self, problem: WorkspaceProblem) -> tuple[Needed, ...]:
        """None: the range of motion is in the file."""
        return ()

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

    def table(self, outcome: WorkspaceOutcome) -> Table:
        """A column for each range of motion."""
        from rehab_opt.session.workspaces.table import workspace_table  # noqa: PLC0415  (loads rich)

        return workspace_table(outcome)

    def trace(self, outcome: WorkspaceOutcome) -> Iterator[Column]:
        """A row for each vertex of the boundaries."""
        from rehab_opt.session.workspaces.trace import boundary_columns  # noqa: PLC0415

        return boundary_columns({name: of.workspace for name, of in outcome.sets.items()})

    def figures(self, outcome: WorkspaceOutcome) -> dict[str, Figure]:
        """The slices seen from above, and the volumes where they were asked for."""
        from rehab_opt.session.workspaces.figures import workspace_figures  # noqa: PLC0415  (loads matplotlib)

        return workspace_figures(outcome)
