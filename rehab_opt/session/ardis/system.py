"""`system = "ardis"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager

from rehab_opt.session.ardis.outcome import ArdisOutcome
from rehab_opt.session.ardis.problem import ArdisProblem
from rehab_opt.session.ardis.robot import joystick_of, resolver_of, robot_of, start_of
from rehab_opt.session.ardis.run import run_ardis, sticks_of
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.outcome import Progress
from rehab_opt.session.plant.making import on_plant
from rehab_opt.session.solver_option import checked_solver, solver_refusals
from rehab_opt.session.systems import ROBOT_FILE, Needed, System

__all__ = ["ArdisSystem"]


class ArdisSystem(System[ArdisProblem, ArdisOutcome]):
    """A wheelchair with an arm, moved by one stick, with each drive that has a recording of it."""

    schema = ArdisProblem
    shown = ("rehab_opt.session.ardis.table", "rehab_opt.session.ardis.figures", "rehab_opt.session.ardis.figures")
    options = frozenset({"plant", "solver"})

    def recordings(self, problem: ArdisProblem) -> tuple[Needed, ...]:
        """A recording of the stick for each drive, and the robot file where there is one."""
        sticks = tuple(Needed(f"stick.{drive}", file) for drive, file in problem.stick.recordings.items())
        return sticks if problem.robot.file is None else (*sticks, Needed(ROBOT_FILE, problem.robot.file))

    def check(self, loaded: ProblemFile[ArdisProblem]) -> tuple[str, ...]:
        """Reads the sticks, builds the robot and its controllers."""
        on_plant(loaded, None)
        robot = robot_of(loaded)
        start_of(loaded, robot)
        joystick_of(loaded)
        sticks = sticks_of(loaded)
        with _refusals(loaded, None):
            for drive in sticks:
                resolver_of(loaded, robot, drive)
        return robot.chain.notes

    def run(self, loaded: ProblemFile[ArdisProblem], *, options: Mapping[str, str], progress: Progress) -> ArdisOutcome:
        """Options: `solver` of the controller, `plant`."""
        solver = checked_solver(options.get("solver"))
        loaded = on_plant(loaded, options.get("plant"))
        with _refusals(loaded, solver):
            return run_ardis(loaded, solver=solver, progress=progress)

    def live(self, loaded: ProblemFile[ArdisProblem], *, options: Mapping[str, str]) -> LiveProblem:
        """The stick in somebody's hand; options as of `run`."""
        from rehab_opt.session.ardis.live import LiveArdis  # noqa: PLC0415  (for those who look)

        solver = checked_solver(options.get("solver"))
        with _refusals(loaded, solver):
            return LiveArdis(on_plant(loaded, options.get("plant")), solver=solver)

    def seconds_a_tick(self, problem: ArdisProblem) -> float:
        """Of the controller."""
        return 1 / problem.run.rate_hz


def _refusals(loaded: ProblemFile[ArdisProblem], solver: str | None) -> AbstractContextManager[None]:
    return solver_refusals(solver, file=loaded.file, key="run.solver", value=loaded.problem.run.solver)
