"""`system = "workspace_map"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.recording_size import size_note
from rehab_opt.session.systems import Column, Needed
from rehab_opt.session.workspace_maps.outcome import MapOutcome
from rehab_opt.session.workspace_maps.problem import WorkspaceMapProblem
from rehab_opt.session.workspace_maps.run import ENDS, arm_of_set, placed_trajectory, run_workspace_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = ["WorkspaceMapSystem"]


class WorkspaceMapSystem:
    """Maps between two workspaces."""

    schema = WorkspaceMapProblem
    options: frozenset[str] = frozenset()

    def recordings(self, problem: WorkspaceMapProblem) -> tuple[Needed, ...]:
        """The trajectories."""
        return tuple(
            Needed(f"trajectory.{i}.recording.file", trajectory.recording.file)
            for i, trajectory in enumerate(problem.trajectory)
        )

    def check(self, loaded: ProblemFile[WorkspaceMapProblem]) -> tuple[str, ...]:
        """Builds the arms and reads the trajectories."""
        for end in ENDS:
            said = arm_of_set(loaded.problem, end)
            arm_of(said.section.side, said.section.segments, said.ranges, file=loaded.file, key=said.key)
        recordings = [placed_trajectory(loaded, i)[0] for i in range(len(loaded.problem.trajectory))]
        return tuple(
            f"{recording.file}: {note}" for recording in recordings for note in (*recording.notes, size_note(recording))
        )

    def run(
        self, loaded: ProblemFile[WorkspaceMapProblem], *, options: Mapping[str, str], progress: Progress
    ) -> MapOutcome:
        """No options."""
        return run_workspace_map(loaded, progress=progress)

    def table(self, outcome: MapOutcome) -> Table:
        """A column for each direction and rule."""
        from rehab_opt.session.workspace_maps.table import map_table  # noqa: PLC0415  (loads rich)

        return map_table(outcome)

    def trace(self, outcome: MapOutcome) -> Iterator[Column]:
        """A row for each sample of a trajectory."""
        from rehab_opt.session.workspace_maps.trace import trajectory_columns  # noqa: PLC0415

        return trajectory_columns(outcome)

    def figures(self, outcome: MapOutcome) -> dict[str, Figure]:
        """Grid and trajectories before and after, and where maps fold."""
        from rehab_opt.session.workspace_maps.figures import map_figures  # noqa: PLC0415  (loads matplotlib)

        return map_figures(outcome)
