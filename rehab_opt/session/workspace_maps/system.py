"""`system = "workspace_map"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.recording_size import size_note
from rehab_opt.session.systems import Needed, System
from rehab_opt.session.workspace_maps.outcome import MapOutcome
from rehab_opt.session.workspace_maps.problem import WorkspaceMapProblem
from rehab_opt.session.workspace_maps.run import ENDS, arm_of_set, placed_trajectory, run_workspace_map

__all__ = ["WorkspaceMapSystem"]


class WorkspaceMapSystem(System[WorkspaceMapProblem, MapOutcome]):
    """Maps between two workspaces."""

    schema = WorkspaceMapProblem
    shown = ("rehab_opt.session.workspace_maps.shown",)

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
