"""`system = "pose_tracking"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.outcome import Progress
from rehab_opt.session.plant.making import on_plant
from rehab_opt.session.pose_tracking.outcome import RobotOutcome
from rehab_opt.session.pose_tracking.problem import PoseTracking
from rehab_opt.session.pose_tracking.robot import robot_at_start, robot_files, run_pose_tracking, tracker_of
from rehab_opt.session.solver_option import checked_solver, solver_refusals
from rehab_opt.session.systems import Needed, System

__all__ = ["PoseTrackingSystem"]


class PoseTrackingSystem(System[PoseTracking, RobotOutcome]):
    """A simulated robot that follows a circle with `PoseTracker`."""

    schema = PoseTracking
    shown = ("rehab_opt.session.pose_tracking.shown",)
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

    def live(self, loaded: ProblemFile[PoseTracking], *, options: Mapping[str, str]) -> LiveProblem:
        """The circle, until somebody drags the target; options as of `run`."""
        from rehab_opt.session.pose_tracking.live import LivePoseTracking  # noqa: PLC0415  (for those who look)

        solver = checked_solver(options.get("solver"))
        with _refusals(loaded, solver):
            return LivePoseTracking(on_plant(loaded, options.get("plant")), solver=solver)

    def seconds_a_tick(self, problem: PoseTracking) -> float:
        """Of the tracker."""
        return 1 / problem.tracker.rate_hz


def _refusals(loaded: ProblemFile[PoseTracking], solver: str | None) -> AbstractContextManager[None]:
    return solver_refusals(solver, file=loaded.file, key="tracker.solver", value=loaded.problem.tracker.solver)
