"""`system = "pose_tracking"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.plant.making import on_plant
from rehab_opt.session.pose_tracking.outcome import RobotOutcome
from rehab_opt.session.pose_tracking.problem import PoseTracking
from rehab_opt.session.pose_tracking.robot import robot_at_start, robot_files, run_pose_tracking, tracker_of
from rehab_opt.session.solver_option import checked_solver, solver_refusals
from rehab_opt.session.systems import Column, Needed

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = ["PoseTrackingSystem"]


class PoseTrackingSystem:
    """A simulated robot that follows a circle with `PoseTracker`."""

    schema = PoseTracking
    options = frozenset({"plant", "solver"})

    def recordings(self, problem: PoseTracking) -> tuple[Needed, ...]:
        """No recording, since the circle is computed; the robot file."""
        return robot_files(problem.robot)

    def check(self, loaded: ProblemFile[PoseTracking]) -> tuple[str, ...]:
        """Builds the robot and the tracker."""
        on_plant(loaded, None)
        robot, _ = robot_at_start(loaded)
        with _refusals(loaded, None):
            tracker_of(loaded.problem, robot, file=loaded.file)
        return robot.notes

    def run(self, loaded: ProblemFile[PoseTracking], *, options: Mapping[str, str], progress: Progress) -> RobotOutcome:
        """Options: `solver` of the tracker, `plant`."""
        solver = checked_solver(options.get("solver"))
        on = on_plant(loaded, options.get("plant"))
        with _refusals(loaded, solver):
            return run_pose_tracking(on, solver=solver, progress=progress)

    def seconds_a_tick(self, problem: PoseTracking) -> float:
        """Of the tracker."""
        return 1 / problem.tracker.rate_hz

    def table(self, outcome: RobotOutcome) -> Table:
        """One column, the tracker's."""
        from rehab_opt.session.pose_tracking.table import robot_table  # noqa: PLC0415  (loads rich)

        return robot_table(outcome)

    def trace(self, outcome: RobotOutcome) -> Iterator[Column]:
        """A row for each tick."""
        from rehab_opt.session.pose_tracking.trace import robot_columns  # noqa: PLC0415

        return robot_columns(outcome)

    def figures(self, outcome: RobotOutcome) -> dict[str, Figure]:
        """The path of the tool, the joints, the errors."""
        from rehab_opt.session.pose_tracking.figures import robot_figures  # noqa: PLC0415  (loads matplotlib)

        return robot_figures(outcome)


def _refusals(loaded: ProblemFile[PoseTracking], solver: str | None) -> AbstractContextManager[None]:
    return solver_refusals(solver, file=loaded.file, key="tracker.solver", value=loaded.problem.tracker.solver)
