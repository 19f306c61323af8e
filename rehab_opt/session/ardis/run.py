"""The run of `system = "ardis"`: each drive under its stick, with the published law and with ours."""

from __future__ import annotations

from collections.abc import Mapping

from rehab_opt.session.ardis.measures import drive_metrics
from rehab_opt.session.ardis.outcome import ArdisOutcome, DriveOutcome, Motion, Published, StickLaw, moved
from rehab_opt.session.ardis.problem import ArdisProblem, DriveName
from rehab_opt.session.ardis.robot import joystick_of, resolver_of, robot_of, room_of, start_of
from rehab_opt.session.ardis.stick import sticks_of
from rehab_opt.session.clearance import NearestBodies, nearest_bodies
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.outcome import Progress
from rehab_opt.session.plant.making import chair_plant, joint_feedback, plant_note
from rehab_opt.session.systems import ROBOT_FILE, Needed, System

__all__ = ["ArdisSystem", "run_ardis"]


ROBOT_OF_PAPER = "lengths, masses and limits of the robot are assumptions: the paper gives joints and axes only"
ROBOT_OF_FILE = (
    "the chair, its user and what motors add to the joints are those of `ardis` and `arm_on_chair`: assumptions; where "
    "the arm's numbers are from its robot file says"
)
RECORDED = (
    "the stick is a recording of a user who saw another robot, and steers this one blindly; speeds and accelerations "
    "are those that were sent"
)


def run_ardis(loaded: ProblemFile[ArdisProblem], *, solver: str | None, progress: Progress) -> ArdisOutcome:
    """Give each drive's stick to both laws and measure.

    Raises
    ------
    ProblemFileError : a value of the file or a recording cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw  # noqa: PLC0415  (loads CasADi)

    problem, robot = loaded.problem, robot_of(loaded)
    start, room, sticks = start_of(loaded, robot), room_of(loaded), sticks_of(loaded)
    dt = 1 / problem.run.rate_hz

    def run(drive: DriveName, name: str, law: StickLaw) -> Motion:
        table = problem.plant
        plant = None
        if table.kind != "ideal":
            plant = chair_plant(table, robot, robot.drive(drive), dt, own_arm=problem.robot.file is not None)
        return moved(
            robot, law, joystick_of(loaded), sticks[drive], start, dt=dt, plant=plant,
            progress=lambda done, of: progress(f"{drive}, {name} law", done, of),
        )  # fmt: skip

    drives: dict[DriveName, DriveOutcome] = {}
    near: dict[DriveName, NearestBodies] = {}
    for drive in sticks:
        ours = resolver_of(loaded, robot, drive, solver=solver, feedback=joint_feedback(problem.plant))
        theirs = Published(PseudoinverseLaw(robot, drive=drive, self_motion=problem.run.self_motion))
        drives[drive] = DriveOutcome(published=run(drive, "published", theirs), optimised=run(drive, "optimised", ours))
        ran = drives[drive].optimised
        seen = nearest_bodies(problem.clearance, loaded.file, robot.bodied_chain, ran.q, ran.time)
        near |= {} if seen is None else {drive: seen}
    metrics = {
        drive: drive_metrics(robot, drive, outcome, room=room, goals=problem.goals) for drive, outcome in drives.items()
    }
    return ArdisOutcome(
        notes=(
            plant_note(
                problem.plant, "the robot is simulated: chair and arm move exactly as commanded, whichever law commands"
            ),
            *(() if problem.plant.kind == "ideal" else (RECORDED,)),
            ROBOT_OF_PAPER if problem.robot.file is None else ROBOT_OF_FILE,
            "walls and posts are kept from the chair's outline; the arm may reach over them",
            *robot.chain.notes,
            *(f"{drive} drive: {seen.note}" for drive, seen in near.items()),
        ),
        metrics={
            "drives": metrics,
            **({"clearance": {drive: seen.metrics for drive, seen in near.items()}} if near else {}),
        },
        robot=robot,
        room=room,
        goals=tuple(problem.goals),
        drives=drives,
        near=near,
    )


class ArdisSystem(System[ArdisProblem, ArdisOutcome]):
    """A wheelchair with an arm, moved by one stick, with each drive that has a recording of it."""

    schema = ArdisProblem
    shown = ("rehab_opt.session.ardis.table", "rehab_opt.session.ardis.figures", "rehab_opt.session.ardis.figures")
    options = frozenset({"plant", "solver"})
    solver_key = "run.solver"

    def recordings(self, problem: ArdisProblem) -> tuple[Needed, ...]:
        """A recording of the stick for each drive, and the robot file where there is one."""
        sticks = tuple(Needed(f"stick.{drive}", file) for drive, file in problem.stick.recordings.items())
        return sticks if problem.robot.file is None else (*sticks, Needed(ROBOT_FILE, problem.robot.file))

    def check(self, loaded: ProblemFile[ArdisProblem]) -> tuple[str, ...]:
        """Reads the sticks, builds the robot and its controllers."""
        robot = robot_of(loaded)
        start_of(loaded, robot)
        joystick_of(loaded)
        for drive in sticks_of(loaded):
            resolver_of(loaded, robot, drive)
        return robot.chain.notes

    def run(self, loaded: ProblemFile[ArdisProblem], *, options: Mapping[str, str], progress: Progress) -> ArdisOutcome:
        """Options: `solver` of the controller, `plant`."""
        return run_ardis(loaded, solver=options.get("solver"), progress=progress)

    def live(self, loaded: ProblemFile[ArdisProblem], *, options: Mapping[str, str]) -> LiveProblem:
        """The stick in somebody's hand; options as of `run`."""
        from rehab_opt.session.ardis.live import LiveArdis  # noqa: PLC0415  (for those who look)

        return LiveArdis(loaded, solver=options.get("solver"))

    def seconds_a_tick(self, problem: ArdisProblem) -> float:
        """Of the controller."""
        return 1 / problem.run.rate_hz
