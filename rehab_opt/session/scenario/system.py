"""`system = "scenario"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.outcome import Progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.scenario.demonstrated import learnt, needed_demonstrations
from rehab_opt.session.scenario.laws import check_bounds
from rehab_opt.session.scenario.loop import robot_model_of
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.prepared import given_path
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.run import run_scenario
from rehab_opt.session.systems import Needed, System

__all__ = ["ScenarioSystem"]


class ScenarioSystem(System[ScenarioProblem, ScenarioOutcome]):
    """The five scenarios of therapy and help."""

    schema = ScenarioProblem
    shown = ("rehab_opt.session.scenario.table", "rehab_opt.session.scenario.figures")
    options = frozenset({"plant", "solver"})

    def recordings(self, problem: ScenarioProblem) -> tuple[Needed, ...]:
        """The helper's movement and the therapist's, where some are named."""
        recording = problem.task.recording
        helper = () if recording is None else (Needed("task.recording.file", recording.file),)
        return helper + needed_demonstrations(problem)

    def check(self, loaded: ProblemFile[ScenarioProblem]) -> tuple[str, ...]:
        """Builds arm, robot and the force's bounds, reads recordings, learns; the run sees where the task lies."""
        self.arms(loaded)
        robot_model_of(loaded)
        check_bounds(loaded, solver=None)
        path, notes = given_path(loaded)
        led = learnt(loaded, path)
        return (*notes, *(() if led is None else led.notes))

    def arms(self, loaded: ProblemFile[ScenarioProblem]) -> dict[str, SerialChain]:
        """The arm within what is comfortable, and within what can be helped."""
        arm = loaded.problem.arm
        return {
            name: arm_of(arm.side, arm.segments, getattr(arm, name), file=loaded.file)
            for name in ("comfortable", "reachable")
        }

    def run(
        self, loaded: ProblemFile[ScenarioProblem], *, options: Mapping[str, str], progress: Progress
    ) -> ScenarioOutcome:
        """Options: `solver`, `plant`."""
        return run_scenario(loaded, solver=options.get("solver"), progress=progress)

    def live(self, loaded: ProblemFile[ScenarioProblem], *, options: Mapping[str, str]) -> LiveProblem:
        """The person as the file has them, until somebody points where the hand shall be; options as of `run`."""
        from rehab_opt.session.scenario.live import LiveScenario  # noqa: PLC0415  (for those who look)

        robot_model_of(loaded)
        check_bounds(loaded, solver=options.get("solver"))
        return LiveScenario(loaded, solver=options.get("solver"))

    def seconds_a_tick(self, problem: ScenarioProblem) -> float:
        """Of the assistance."""
        return 1 / problem.run.rate_hz
