"""`system = "mirror"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.outcome import Progress
from rehab_opt.session.pose_tracking.robot import robot_files
from rehab_opt.session.systems import Needed, System

if TYPE_CHECKING:
    from rehab_opt.session.mirror.outcome import MirrorOutcome

__all__ = ["MirrorSystem"]


class MirrorSystem(System[MirrorProblem, "MirrorOutcome"]):
    """A hand led along the other hand's mirrored path."""

    schema = MirrorProblem
    shown = ("rehab_opt.session.mirror.table", "rehab_opt.session.mirror.figures")
    options = frozenset({"plant"})

    def recordings(self, problem: MirrorProblem) -> tuple[Needed, ...]:
        """The hand's poses, the points that tell where they were seen, and the robot file."""
        needed = (Needed("recording.file", problem.recording.file), *robot_files(problem.robot))
        points = problem.placement.calibration_file
        return needed if points is None else (*needed, Needed("placement.calibration_file", points))

    def check(self, loaded: ProblemFile[MirrorProblem]) -> tuple[str, ...]:
        """Reads the recording, lays it out, builds the tracker, and counts what the robot reaches."""
        from rehab_opt.session.mirror.laws import tracker_of  # noqa: PLC0415  (loads solvers)
        from rehab_opt.session.mirror.placing import reach_note  # noqa: PLC0415
        from rehab_opt.session.mirror.scene import laid_out, path_notes  # noqa: PLC0415

        scene = laid_out(loaded)
        tracker = tracker_of(loaded.problem, scene, file=loaded.file)
        return (*scene.notes, *path_notes(scene), reach_note(loaded.problem, scene, tracker))

    def run(
        self, loaded: ProblemFile[MirrorProblem], *, options: Mapping[str, str], progress: Progress
    ) -> MirrorOutcome:
        """The option is `plant`."""
        from rehab_opt.session.mirror.run import run_mirror  # noqa: PLC0415  (loads solvers)

        return run_mirror(loaded, progress=progress)

    def live(self, loaded: ProblemFile[MirrorProblem], *, options: Mapping[str, str]) -> LiveProblem:
        """The mirrored recording to and fro, until somebody drags the hand; the option is `plant`."""
        from rehab_opt.session.mirror.live import LiveMirror  # noqa: PLC0415  (loads solvers)

        return LiveMirror(loaded)

    def seconds_a_tick(self, problem: MirrorProblem) -> float:
        """Of the tracker."""
        return 1 / problem.tracker.rate_hz
